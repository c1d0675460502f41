import java.util.List;
import java.util.StringJoiner;
import java.util.concurrent.ConcurrentLinkedQueue;
import java.util.concurrent.TimeUnit;
import org.eclipse.milo.opcua.sdk.client.OpcUaClient;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaMonitoredItem;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaSubscription;
import org.eclipse.milo.opcua.stack.core.StatusCodes;
import org.eclipse.milo.opcua.stack.core.UaException;
import org.eclipse.milo.opcua.stack.core.types.builtin.DataValue;
import org.eclipse.milo.opcua.stack.core.types.builtin.NodeId;
import org.eclipse.milo.opcua.stack.core.types.builtin.StatusCode;
import org.eclipse.milo.opcua.stack.core.types.builtin.Variant;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.UInteger;
import org.eclipse.milo.opcua.stack.core.types.enumerated.TimestampsToReturn;

/**
 * A client of somebody else's, for our servers: TheirClient URL NAMESPACE NODE WRITE READ...
 *
 * <p>Listens to NODE for three seconds, tries to write 1.5 to WRITE, and reads each READ. Says it all as JSON.
 */
public final class TheirClient {
  public static void main(String[] words) throws Exception {
    var client = OpcUaClient.create(words[0]);
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
    TimeUnit.SECONDS.sleep(3);
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
        "{\"seen\": [" + String.join(", ", seen) + "], \"written\": \"" + name(written) + "\", \"read\": {" + read + "}}");
    subscription.delete();
    client.disconnect();
    System.exit(0);
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
