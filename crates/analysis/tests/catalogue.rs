//! The catalogue that the other faces are checked against is that of the crates as they are.

#[allow(dead_code)] // its main
#[path = "../examples/catalogue.rs"]
mod catalogue;

#[test]
fn every_setting_has_a_number_of_its_own() {
    let catalogue: serde_json::Value = serde_json::from_str(&catalogue::text()).unwrap();
    for (block, settings) in catalogue["settings"].as_object().unwrap() {
        for setting in settings.as_array().unwrap() {
            let name = setting["name"].as_str().unwrap();
            assert!(catalogue["parameters"][name].is_u64(), "{block}: {name}");
        }
    }
    assert_eq!(catalogue["parameters"].as_object().unwrap().len(), glapp_core::PARAMETERS.len());
}

#[test]
fn is_up_to_date() {
    let kept = include_str!("../../../vectors/catalogue.json");
    assert_eq!(kept.trim_end(), catalogue::text(), "write it anew: make catalogue");
}
