//! Writes `plc/SelfTest.st` and `plc/real/SelfTest.st`, with the numbers of the core: `cargo run -p glapp-plc-check --example self_test`.

#[path = "../tests/twins/common/mod.rs"]
mod common;

use common::{folder, self_test};

fn main() {
    for (place, text) in
        [("SelfTest.st", self_test::written::<f64>()), ("real/SelfTest.st", self_test::written::<f32>())]
    {
        std::fs::write(folder().join(place), text).expect("a file");
    }
}
