import java.io.IOException;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.GeneralSecurityException;
import java.security.KeyFactory;
import java.security.KeyPair;
import java.security.cert.CertificateFactory;
import java.security.cert.X509Certificate;
import java.security.spec.PKCS8EncodedKeySpec;
import java.util.Base64;
import org.eclipse.milo.opcua.stack.core.security.MemoryTrustListManager;

/** Certificates and keys that the test has made: NAME.der and NAME.pem in a folder. */
record Pki(Path folder) {
  X509Certificate certificate(String name) throws IOException, GeneralSecurityException {
    try (var file = Files.newInputStream(folder.resolve(name + ".der"))) {
      return (X509Certificate) CertificateFactory.getInstance("X.509").generateCertificate(file);
    }
  }

  KeyPair keys(String name) throws IOException, GeneralSecurityException {
    var text = Files.readString(folder.resolve(name + ".pem")).replaceAll("-----[A-Z ]+-----|\\s", "");
    var key = new PKCS8EncodedKeySpec(Base64.getDecoder().decode(text));
    return new KeyPair(certificate(name).getPublicKey(), KeyFactory.getInstance("RSA").generatePrivate(key));
  }

  /** Nobody else is trusted. */
  MemoryTrustListManager trusting(String name) throws IOException, GeneralSecurityException {
    var trusted = new MemoryTrustListManager();
    trusted.addTrustedCertificate(certificate(name));
    return trusted;
  }
}
