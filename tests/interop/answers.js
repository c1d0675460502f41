// A client of somebody else's, for our servers: node answers.js URL NAMESPACE NODE WRITE READ...
// Listens to NODE until it has changed a dozen times, tries to write 1.5 to WRITE, and reads each READ. Says it all as JSON.
// Where the environment's PKI names a folder, it shows client.der, trusts server.der alone, and encrypts by Basic256Sha256
// as the user dcs; before that it tries a wrong password, and a server that it does not trust.
const { OPCUAClient, AttributeIds, TimestampsToReturn, UserTokenType } = require("node-opcua-client");
const { MessageSecurityMode, SecurityPolicy } = require("node-opcua-secure-channel");
const { DataType } = require("node-opcua-variant");
const { known } = require("./pki");

const [url, uri, listen, write, ...reads] = process.argv.slice(2);
const folder = process.env.PKI;

async function connected(trusted, password) {
  const options = { endpointMustExist: false, connectionStrategy: { maxRetry: 0 } };
  if (folder) {
    const { manager, ...own } = await known(folder, "client", trusted);
    Object.assign(options, own, {
      applicationUri: "urn:glapp:client",
      clientCertificateManager: manager,
      securityMode: MessageSecurityMode.SignAndEncrypt,
      securityPolicy: SecurityPolicy.Basic256Sha256,
    });
  }
  const client = OPCUAClient.create(options);
  try {
    await client.connect(url);
    const user = { type: UserTokenType.UserName, userName: "dcs", password };
    return { client, session: await client.createSession(folder ? user : undefined) };
  } catch (error) {
    await client.disconnect();
    throw error;
  }
}

async function refused(trusted, password) {
  try {
    const { client } = await connected(trusted, password);
    await client.disconnect();
    return "Good";
  } catch (error) {
    return error.message;
  }
}

async function main() {
  const denied = {};
  if (folder) {
    denied.password = await refused("server", "a guess of ten");
    denied.certificate = await refused("stranger", "long enough");
  }
  const { client, session } = await connected("server", "long enough");
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
  for (let i = 0; i < 600 && seen.length < 12; i++) await new Promise((resolve) => setTimeout(resolve, 100));
  const asking = session.write({ ...value(write), value: { value: { dataType: DataType.Double, value: 1.5 } } });
  const written = await asking.catch((error) => error.response.responseHeader.serviceResult);
  const read = {};
  for (const name of reads) read[name] = shown(await session.read(value(name)));
  console.log(JSON.stringify({ seen, written: written.name, read, refused: denied }));
  await session.close();
  await client.disconnect();
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
