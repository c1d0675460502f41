//! The catalogue that the other faces are checked against is that of the crates as they are.

#[allow(dead_code)] // its main
#[path = "../examples/catalogue.rs"]
mod catalogue;

#[test]
fn is_up_to_date() {
    let kept = include_str!("../../../vectors/catalogue.json");
    assert_eq!(kept.trim_end(), catalogue::text(), "write it anew: make catalogue");
}
