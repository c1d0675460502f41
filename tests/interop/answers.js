// A client of somebody else's, for our servers: node answers.js URL NAMESPACE NODE WRITE READ...
// Listens to NODE for three seconds, tries to write 1.5 to WRITE, and reads each READ. Says it all as JSON.
const { OPCUAClient, AttributeIds, TimestampsToReturn } = require("node-opcua-client");
const { DataType } = require("node-opcua-variant");

async function main() {
  const [url, uri, listen, write, ...reads] = process.argv.slice(2);
  const client = OPCUAClient.create({ endpointMustExist: false });
  await client.connect(url);
  const session = await client.createSession();
  const index = (await session.readNamespaceArray()).indexOf(uri);
  const value = (name) => ({ nodeId: `ns=${index};s=${name}`, attributeId: AttributeIds.Value });
  const shown = (v) => [v.sourceTimestamp && v.sourceTimestamp.getTime() / 1000, v.value.value, v.statusCode.name];
  const seen = [];
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 100, requestedMaxKeepAliveCount: 10, requestedLifetimeCount: 100, publishingEnabled: true,
  });
  const asked = { samplingInterval: 100, queueSize: 100, discardOldest: true };
  const item = await subscription.monitor(value(listen), asked, TimestampsToReturn.Both);
  item.on("changed", (v) => seen.push(shown(v)));
  await new Promise((resolve) => setTimeout(resolve, 3000));
  const asking = session.write({ ...value(write), value: { value: { dataType: DataType.Double, value: 1.5 } } });
  const written = await asking.catch((error) => error.response.responseHeader.serviceResult);
  const read = {};
  for (const name of reads) read[name] = shown(await session.read(value(name)));
  console.log(JSON.stringify({ seen, written: written.name, read }));
  await session.close();
  await client.disconnect();
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
