// A client of somebody else's, for our server: node client.js URL NAMESPACE
// Listens to FIC101.PV until it has changed 25 times, reads the history from the third of these to the 23rd, tries to write
// SP, writes U_FF and reads it.
const { OPCUAClient, AttributeIds, TimestampsToReturn } = require("node-opcua-client");
const { DataType } = require("node-opcua-variant");

async function main() {
  const [url, uri] = process.argv.slice(2);
  const client = OPCUAClient.create({ endpointMustExist: false });
  await client.connect(url);
  const session = await client.createSession();
  const index = (await session.readNamespaceArray()).indexOf(uri);
  const value = (name) => ({ nodeId: `ns=${index};s=FIC101.${name}`, attributeId: AttributeIds.Value });
  const double = (x) => ({ value: { value: { dataType: DataType.Double, value: x } } });
  const seen = [];
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 100, requestedMaxKeepAliveCount: 10, requestedLifetimeCount: 100, publishingEnabled: true,
  });
  const asked = { samplingInterval: 100, queueSize: 100, discardOldest: true };
  const item = await subscription.monitor(value("PV"), asked, TimestampsToReturn.Both);
  const shown = (v) => [v.sourceTimestamp.getTime() / 1000, v.value.value, v.statusCode.name];
  item.on("changed", (v) => seen.push(shown(v)));
  for (let i = 0; i < 600 && seen.length < 25; i++) await new Promise((resolve) => setTimeout(resolve, 100));
  // A Date holds whole milliseconds and the plant's times are finer, so half a scan more is asked on each side.
  const [begin, end] = [seen[2][0] - 0.05, seen[22][0] + 0.05].map((time) => new Date(Math.round(1000 * time)));
  const history = await session.readHistoryValue(value("PV"), begin, end);
  const refused = await session.write({ ...value("SP"), ...double(1) });
  const written = await session.write({ ...value("U_FF"), ...double(0.5) });
  const back = await session.read(value("U_FF"));
  console.log(JSON.stringify({
    seen, history: history.historyData.dataValues.map(shown), refused: refused.name, written: written.name,
    back: back.value.value,
  }));
  await session.close();
  await client.disconnect();
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
