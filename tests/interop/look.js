// Values at u_FF's nodes, as another maker's client sees them: node look.js URL NAMESPACE LOOP... Reads the nodes every
// 50 ms and prints a line of JSON for each change of any of them: seconds since 1970, loop, value; a loop of null: the
// server is lost. Ends with its standard input.
const { OPCUAClient, AttributeIds } = require("node-opcua-client");

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const say = (loop, value) => console.log(JSON.stringify([Date.now() / 1000, loop, value]));

async function look(url, uri, loops, seen) {
  const client = OPCUAClient.create({ endpointMustExist: false, connectionStrategy: { maxRetry: 0 } });
  try {
    await client.connect(url);
    const session = await client.createSession();
    const index = (await session.readNamespaceArray()).indexOf(uri);
    const nodes = loops.map((loop) => ({ nodeId: `ns=${index};s=${loop}.U_FF`, attributeId: AttributeIds.Value }));
    for (;;) {
      const found = await Promise.race([session.read(nodes), pause(2000).then(() => Promise.reject(new Error("silent")))]);
      found.forEach((one, i) => {
        const value = one.statusCode.name.startsWith("Good") ? one.value.value : null;
        if (seen.get(loops[i]) !== value) say(loops[i], value);
        seen.set(loops[i], value);
      });
      await pause(50);
    }
  } catch {
    say(null, null);
    seen.clear();
  }
  await Promise.race([client.disconnect().catch(() => {}), pause(500)]);
}

async function main() {
  const [url, uri, ...loops] = process.argv.slice(2);
  process.stdin.resume().on("end", () => process.exit(0));
  const seen = new Map();
  for (;;) {
    await look(url, uri, loops, seen);
    await pause(500);
  }
}

main();
