import java.nio.file.Path;
import java.security.cert.X509Certificate;
import java.util.EnumSet;
import java.util.List;
import java.util.StringJoiner;
import java.util.concurrent.ConcurrentLinkedQueue;
import java.util.concurrent.TimeUnit;
import org.eclipse.milo.opcua.sdk.client.OpcUaClient;
import org.eclipse.milo.opcua.sdk.client.identity.UsernameProvider;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaMonitoredItem;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaSubscription;
import org.eclipse.milo.opcua.stack.core.StatusCodes;
import org.eclipse.milo.opcua.stack.core.UaException;
import org.eclipse.milo.opcua.stack.core.security.DefaultClientCertificateValidator;
import org.eclipse.milo.opcua.stack.core.security.MemoryCertificateQuarantine;
import org.eclipse.milo.opcua.stack.core.security.SecurityPolicy;
import org.eclipse.milo.opcua.stack.core.types.builtin.DataValue;
import org.eclipse.milo.opcua.stack.core.types.builtin.NodeId;
import org.eclipse.milo.opcua.stack.core.types.builtin.StatusCode;
import org.eclipse.milo.opcua.stack.core.types.builtin.Variant;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.UInteger;
import org.eclipse.milo.opcua.stack.core.types.enumerated.MessageSecurityMode;
import org.eclipse.milo.opcua.stack.core.types.enumerated.TimestampsToReturn;
import org.eclipse.milo.opcua.stack.core.util.validation.ValidationCheck;

/**
 * A client of somebody else's, for our servers: TheirClient URL NAMESPACE NODE WRITE READ...
 *
 * <p>Listens to NODE until it has changed a dozen times, tries to write 1.5 to WRITE, and reads each READ. Says it all as
 * JSON. Where the environment's PKI names a folder, it shows client.der, trusts server.der alone, and encrypts by
 * Basic256Sha256 as the user dcs; before that it tries a wrong password, and a server that it does not trust.
 */
public final class TheirClient {
  public static void main(String[] words) throws Exception {
    var denied = new StringJoiner(", ");
    OpcUaClient client;
    if (System.getenv("PKI") == null) {
      client = OpcUaClient.create(words[0]);
    } else {
      denied.add("\"password\": \"" + refused(secured(words[0], "server", "a guess of ten")) + "\"");
      denied.add("\"certificate\": \"" + refused(secured(words[0], "stranger", "long enough")) + "\"");
      client = secured(words[0], "server", "long enough");
    }
    client.connect();
    var index = client.readNamespaceTable().getIndex(words[1]);
    var seen = new ConcurrentLinkedQueue<String>();
    var subscription = new OpcUaSubscription(client);
    subscription.setPublishingInterval(100.0);
    var item = OpcUaMonitoredItem.newDataItem(new NodeId(index, words[2]));
    item.setSamplingInterval(100.0);
    item.setQueueSize(UInteger.valueOf(100));
    item.setDataValueListener((one, value) -> seen.add(json(value)));
    subscription.addMonitoredItem(item);
    subscription.create();
    subscription.synchronizeMonitoredItems();
    for (int i = 0; i < 600 && seen.size() < 12; i++) {
      TimeUnit.MILLISECONDS.sleep(100);
    }
    var write = new NodeId(index, words[3]);
    StatusCode written;
    try {
      written = client.writeValues(List.of(write), List.of(DataValue.valueOnly(new Variant(1.5)))).get(0);
    } catch (UaException refused) {
      written = refused.getStatusCode();
    }
    var read = new StringJoiner(", ");
    for (int i = 4; i < words.length; i++) {
      var value = client.readValue(0.0, TimestampsToReturn.Both, new NodeId(index, words[i]));
      read.add("\"" + words[i] + "\": " + json(value));
    }
    System.out.println(
        "{\"seen\": [" + String.join(", ", seen) + "], \"written\": \"" + name(written) + "\", \"read\": {" + read
            + "}, \"refused\": {" + denied + "}}");
    subscription.delete();
    client.disconnect();
    System.exit(0);
  }

  private static OpcUaClient secured(String url, String trusted, String password) throws Exception {
    var pki = new Pki(Path.of(System.getenv("PKI")));
    var keys = pki.keys("client");
    var own = pki.certificate("client");
    var checks =
        EnumSet.of(
            ValidationCheck.APPLICATION_URI,
            ValidationCheck.VALIDITY,
            ValidationCheck.KEY_USAGE_END_ENTITY,
            ValidationCheck.EXTENDED_KEY_USAGE_END_ENTITY);
    var validator =
        new DefaultClientCertificateValidator(pki.trusting(trusted), checks, new MemoryCertificateQuarantine());
    return OpcUaClient.create(
        url,
        endpoints ->
            endpoints.stream()
                .filter(one -> one.getSecurityMode() == MessageSecurityMode.SignAndEncrypt)
                .filter(one -> one.getSecurityPolicyUri().equals(SecurityPolicy.Basic256Sha256.getUri()))
                .findFirst(),
        transport -> {},
        config ->
            config
                .setApplicationUri("urn:glapp:client")
                .setKeyPair(keys)
                .setCertificate(own)
                .setCertificateChain(new X509Certificate[] {own})
                .setCertificateValidator(validator)
                .setIdentityProvider(new UsernameProvider("dcs", password)));
  }

  /** With which status it cannot connect. */
  private static String refused(OpcUaClient client) {
    try {
      client.connect();
      client.disconnect();
      return "Good";
    } catch (UaException refused) {
      return name(refused.getStatusCode());
    }
  }

  /** Source time [s since 1970 UTC], value and status. */
  private static String json(DataValue value) {
    var time = value.getSourceTime() == null ? null : value.getSourceTime().getJavaTime() / 1000.0;
    var held = value.getValue().getValue();
    var shown = held instanceof Number || held == null ? String.valueOf(held) : "\"" + held + "\"";
    return "[" + time + ", " + shown + ", \"" + name(value.getStatusCode()) + "\"]";
  }

  private static String name(StatusCode status) {
    return StatusCodes.lookup(status.getValue()).map(pair -> pair[0]).orElse("Good").replace("_", "");
  }
}
