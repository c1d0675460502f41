// A plant of somebody else's, for our client: node server.js PORT [FOLDER]
// Tags FIC101.PV (a sine every 100 ms, each fiftieth bad), SP, OP, MODE with a history, U_FF and Watchdog to be written.
// With a folder it is the server of theirs.der, speaks Basic256Sha256 only, with who shows ours.der, to the user glapp with
// the password secret.
const { OPCUAServer } = require("node-opcua-server");
const { MessageSecurityMode, SecurityPolicy } = require("node-opcua-secure-channel");
const { DataType } = require("node-opcua-variant");
const { StatusCodes } = require("node-opcua-status-code");
const { known } = require("./pki");

const [port, folder] = process.argv.slice(2);

async function main() {
  const options = { port: Number(port), resourcePath: "/plant", allowAnonymous: !folder };
  if (folder) {
    const { manager, ...own } = await known(folder, "theirs", "ours");
    Object.assign(options, own, {
      serverInfo: { applicationUri: "urn:glapp:theirs" },
      serverCertificateManager: manager,
      userCertificateManager: manager,
      securityModes: [MessageSecurityMode.SignAndEncrypt, MessageSecurityMode.Sign],
      securityPolicies: [SecurityPolicy.Basic256Sha256],
      userManager: { isValidUser: (name, password) => name === "glapp" && password === "secret" },
    });
  }
  const server = new OPCUAServer(options);
  await server.initialize();
  const space = server.engine.addressSpace;
  const own = space.getOwnNamespace();
  const loop = own.addFolder("ObjectsFolder", { browseName: "FIC101" });
  const add = (name, dataType, accessLevel) => own.addVariable({
    componentOf: loop, browseName: name, nodeId: `s=FIC101.${name}`, dataType, accessLevel, userAccessLevel: accessLevel,
  });
  const tags = {};
  for (const [name, type] of [["PV", "Double"], ["SP", "Double"], ["OP", "Float"], ["MODE", "Int32"]]) {
    tags[name] = add(name, type, "CurrentRead | HistoryRead");
    space.installHistoricalDataNode(tags[name], { maxOnlineValues: 100000 });
  }
  tags.U_FF = add("U_FF", "Float", "CurrentRead | CurrentWrite");
  tags.Watchdog = add("Watchdog", "UInt32", "CurrentRead | CurrentWrite");
  const set = (name, dataType, value, status = StatusCodes.Good) =>
    tags[name].setValueFromSource({ dataType: DataType[dataType], value }, status, new Date());
  set("SP", "Double", 50);
  set("MODE", "Int32", 1);
  set("U_FF", "Float", 0);
  set("Watchdog", "UInt32", 0);
  let n = 0;
  setInterval(() => {
    n += 1;
    set("PV", "Double", 50 + Math.sin(n / 10), n % 50 ? StatusCodes.Good : StatusCodes.BadSensorFailure);
    set("OP", "Float", 40 + (n % 3));
  }, 100);
  await server.start();
  console.log(JSON.stringify({ uri: own.namespaceUri }));
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
