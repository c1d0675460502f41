use glapp_plc_check::*;
#[test]
fn thin() {
    let folder = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let library = Library::read(folder, Build::Lreal).unwrap_or_else(|e| panic!("{e}"));
    let mut one = Instance::new(&library, "GlappMedianMean").unwrap();
    one.set("N", 3.0).unwrap();
    for d in [5.0, 40.0, 5.5] { one.set("Detection", d).unwrap(); one.call().unwrap(); }
    assert_eq!(one.get("Estimate.Value").unwrap(), 5.25);
}
