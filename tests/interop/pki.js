// Identity of another maker's program, and the certificates it trusts: made by the test, in a folder.
const fs = require("fs");
const path = require("path");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");

// Certificate and key of the program, and a manager of certificates that trusts one other and nobody else.
async function known(folder, own, trusted) {
  const manager = new OPCUACertificateManager({
    rootFolder: path.join(folder, `${own} trusts ${trusted}`), automaticallyAcceptUnknownCertificate: false,
  });
  await manager.initialize();
  await manager.trustCertificate(fs.readFileSync(path.join(folder, `${trusted}.der`)));
  return { certificateFile: path.join(folder, `${own}.crt`), privateKeyFile: path.join(folder, `${own}.pem`), manager };
}

module.exports = { known };
