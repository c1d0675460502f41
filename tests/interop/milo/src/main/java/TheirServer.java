import java.nio.file.Path;
import java.security.KeyPair;
import java.security.cert.X509Certificate;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.concurrent.Executors;
import java.util.concurrent.TimeUnit;
import org.eclipse.milo.opcua.sdk.core.AccessLevel;
import org.eclipse.milo.opcua.sdk.core.Reference;
import org.eclipse.milo.opcua.sdk.server.EndpointConfig;
import org.eclipse.milo.opcua.sdk.server.ManagedNamespaceWithLifecycle;
import org.eclipse.milo.opcua.sdk.server.OpcUaServer;
import org.eclipse.milo.opcua.sdk.server.OpcUaServerConfig;
import org.eclipse.milo.opcua.sdk.server.identity.AnonymousIdentityValidator;
import org.eclipse.milo.opcua.sdk.server.identity.UsernameIdentityValidator;
import org.eclipse.milo.opcua.sdk.server.items.DataItem;
import org.eclipse.milo.opcua.sdk.server.items.MonitoredItem;
import org.eclipse.milo.opcua.sdk.server.nodes.UaFolderNode;
import org.eclipse.milo.opcua.sdk.server.nodes.UaVariableNode;
import org.eclipse.milo.opcua.sdk.server.util.SubscriptionModel;
import org.eclipse.milo.opcua.stack.core.NodeIds;
import org.eclipse.milo.opcua.stack.core.StatusCodes;
import org.eclipse.milo.opcua.stack.core.security.CertificateStore;
import org.eclipse.milo.opcua.stack.core.security.DefaultApplicationGroup;
import org.eclipse.milo.opcua.stack.core.security.DefaultCertificateManager;
import org.eclipse.milo.opcua.stack.core.security.DefaultServerCertificateValidator;
import org.eclipse.milo.opcua.stack.core.security.MemoryCertificateQuarantine;
import org.eclipse.milo.opcua.stack.core.security.MemoryCertificateStore;
import org.eclipse.milo.opcua.stack.core.security.RsaSha256CertificateFactory;
import org.eclipse.milo.opcua.stack.core.security.SecurityPolicy;
import org.eclipse.milo.opcua.stack.core.types.builtin.DataValue;
import org.eclipse.milo.opcua.stack.core.types.builtin.DateTime;
import org.eclipse.milo.opcua.stack.core.types.builtin.LocalizedText;
import org.eclipse.milo.opcua.stack.core.types.builtin.NodeId;
import org.eclipse.milo.opcua.stack.core.types.builtin.StatusCode;
import org.eclipse.milo.opcua.stack.core.types.builtin.Variant;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.UInteger;
import org.eclipse.milo.opcua.stack.core.types.enumerated.MessageSecurityMode;
import org.eclipse.milo.opcua.stack.transport.server.tcp.OpcTcpServerTransport;
import org.eclipse.milo.opcua.stack.transport.server.tcp.OpcTcpServerTransportConfig;

/**
 * A plant of somebody else's, for our client: TheirServer PORT [FOLDER].
 *
 * <p>Tags FIC101.PV (a sine every 100 ms, each fiftieth bad), SP, OP and MODE, all without a history, U_FF and Watchdog
 * to be written. With a folder it is the server of theirs.der, speaks Basic256Sha256 only, with who shows ours.der, to
 * the user glapp with the password secret.
 */
public final class TheirServer {
  private static final String URI = "urn:milo:plant";

  public static void main(String[] words) throws Exception {
    var endpoint =
        EndpointConfig.newBuilder()
            .setBindAddress("127.0.0.1")
            .setHostname("127.0.0.1")
            .setBindPort(Integer.parseInt(words[0]))
            .setPath("/plant");
    var config =
        OpcUaServerConfig.builder()
            .setApplicationUri("urn:glapp:theirs")
            .setApplicationName(LocalizedText.english("plant"))
            .setProductUri("urn:milo");
    if (words.length == 1) {
      endpoint
          .setSecurityPolicy(SecurityPolicy.None)
          .setSecurityMode(MessageSecurityMode.None)
          .addTokenPolicy(OpcUaServerConfig.USER_TOKEN_POLICY_ANONYMOUS);
      config
          .setCertificateManager(new DefaultCertificateManager(new MemoryCertificateQuarantine()))
          .setIdentityValidator(AnonymousIdentityValidator.INSTANCE);
    } else {
      var pki = new Pki(Path.of(words[1]));
      endpoint
          .setSecurityPolicy(SecurityPolicy.Basic256Sha256)
          .setSecurityMode(MessageSecurityMode.SignAndEncrypt)
          .setCertificate(pki.certificate("theirs"))
          .addTokenPolicy(OpcUaServerConfig.USER_TOKEN_POLICY_USERNAME);
      config
          .setCertificateManager(known(pki))
          .setIdentityValidator(
              new UsernameIdentityValidator(
                  who -> who.getUsername().equals("glapp") && who.getPassword().equals("secret")));
    }
    var server =
        new OpcUaServer(
            config.setEndpoints(Set.of(endpoint.build())).build(),
            profile -> new OpcTcpServerTransport(OpcTcpServerTransportConfig.newBuilder().build()));
    var tags = new Tags(server);
    tags.startup();
    server.startup().get(20, TimeUnit.SECONDS);
    Executors.newSingleThreadScheduledExecutor()
        .scheduleAtFixedRate(tags::scan, 0, 100, TimeUnit.MILLISECONDS);
    System.out.println("{\"uri\": \"" + URI + "\"}");
    Thread.currentThread().join();
  }

  /** It shows theirs.der, and trusts ours.der alone. */
  private static DefaultCertificateManager known(Pki pki) throws Exception {
    var trusted = pki.trusting("ours");
    var quarantine = new MemoryCertificateQuarantine();
    var store = new MemoryCertificateStore();
    var chain = new X509Certificate[] {pki.certificate("theirs")};
    store.set(
        NodeIds.RsaSha256ApplicationCertificateType,
        new CertificateStore.Entry(pki.keys("theirs").getPrivate(), chain));
    var none =
        new RsaSha256CertificateFactory() {
          @Override
          protected X509Certificate[] createRsaSha256CertificateChain(KeyPair keys) {
            throw new IllegalStateException("the store has one");
          }
        };
    return new DefaultCertificateManager(
        quarantine,
        DefaultApplicationGroup.createAndInitialize(
            trusted, store, none, new DefaultServerCertificateValidator(trusted, quarantine)));
  }

  private static final class Tags extends ManagedNamespaceWithLifecycle {
    private final Map<String, UaVariableNode> nodes = new LinkedHashMap<>();
    private final SubscriptionModel subscriptions;
    private int n;

    Tags(OpcUaServer server) {
      super(server, URI);
      subscriptions = new SubscriptionModel(server, this);
      getLifecycleManager().addLifecycle(subscriptions);
      var loop =
          new UaFolderNode(
              getNodeContext(), newNodeId("FIC101"), newQualifiedName("FIC101"), LocalizedText.english("FIC101"));
      getNodeManager().addNode(loop);
      loop.addReference(
          new Reference(
              loop.getNodeId(), NodeIds.Organizes, NodeIds.ObjectsFolder.expanded(), Reference.Direction.INVERSE));
      add(loop, "PV", NodeIds.Double, false);
      add(loop, "SP", NodeIds.Double, false);
      add(loop, "OP", NodeIds.Float, false);
      add(loop, "MODE", NodeIds.Int32, false);
      add(loop, "U_FF", NodeIds.Float, true);
      add(loop, "Watchdog", NodeIds.UInt32, true);
      set("SP", 50.0, StatusCode.GOOD);
      set("MODE", 1, StatusCode.GOOD);
      set("U_FF", 0f, StatusCode.GOOD);
      set("Watchdog", UInteger.valueOf(0), StatusCode.GOOD);
    }

    private void add(UaFolderNode loop, String name, NodeId type, boolean writable) {
      var level = writable ? AccessLevel.READ_WRITE : AccessLevel.READ_ONLY;
      var node =
          new UaVariableNode.UaVariableNodeBuilder(getNodeContext())
              .setNodeId(newNodeId("FIC101." + name))
              .setBrowseName(newQualifiedName(name))
              .setDisplayName(LocalizedText.english(name))
              .setDataType(type)
              .setTypeDefinition(NodeIds.BaseDataVariableType)
              .setAccessLevel(level)
              .setUserAccessLevel(level)
              .build();
      getNodeManager().addNode(node);
      loop.addOrganizes(node);
      nodes.put(name, node);
    }

    private void set(String name, Object value, StatusCode status) {
      var now = DateTime.now();
      nodes.get(name).setValue(new DataValue(new Variant(value), status, now, now));
    }

    void scan() {
      n += 1;
      var status = n % 50 == 0 ? new StatusCode(StatusCodes.Bad_SensorFailure) : StatusCode.GOOD;
      set("PV", 50.0 + Math.sin(n / 10.0), status);
      set("OP", 40.0f + n % 3, StatusCode.GOOD);
    }

    @Override
    public void onDataItemsCreated(List<DataItem> items) {
      subscriptions.onDataItemsCreated(items);
    }

    @Override
    public void onDataItemsModified(List<DataItem> items) {
      subscriptions.onDataItemsModified(items);
    }

    @Override
    public void onDataItemsDeleted(List<DataItem> items) {
      subscriptions.onDataItemsDeleted(items);
    }

    @Override
    public void onMonitoringModeChanged(List<MonitoredItem> items) {
      subscriptions.onMonitoringModeChanged(items);
    }
  }
}
