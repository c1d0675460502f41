//! A loop put together from modules, and changed while it runs: the system of the thesis' section 6.5.
//!
//! Run with `cargo run --example 03_modules`.

use glapp_sim::{Graph, GraphError, Module};

/// Prints what the controller has detected so far.
fn show(plant: &Graph, what: &str) -> Result<(), GraphError> {
    println!("{what}: {:.0} detections, estimate {:.2} %", plant.get("pid.detections")?, plant.get("pid.d_hat")?);
    Ok(())
}

fn main() -> Result<(), GraphError> {
    let pid = [("k", 2.0), ("ti", 2.0), ("tf", 0.2), ("low", 0.0), ("high", 100.0), ("kp", 1.0), ("start", 50.0)];
    let modules = vec![
        ("sp", Module::new("Input", &[("value", 50.0)])?),
        ("load", Module::new("Input", &[("value", 5.0)])?),
        ("pid", Module::new("PidAdvanced", &pid)?),
        ("gap", Module::new("Backlash", &[("d", 2.0)])?),
        ("process", Module::new("ProcessSim", &[("gain", 1.0), ("t1", 3.0), ("t2", 1.0), ("start", 50.0)])?),
        ("noise", Module::new("Noise", &[("amplitude", 0.1), ("seed", 1.0)])?),
    ];
    let wires = ["sp -> pid.sp", "load -> process.load", "pid -> gap -> process -> noise -> pid.pv"];
    let mut plant = Graph::new(0.1, modules, &wires)?;

    plant.run(10_000)?;
    show(&plant, "a gap of 2 %")?;

    plant.set("gap.d", 4.0)?; // the valve wears
    plant.run(10_000)?;
    show(&plant, "a gap of 4 %")?;

    plant.set("pid.mode", 0.0)?; // manual
    let before = plant.get("pid.out")?;
    plant.set("load.value", 10.0)?;
    plant.run(1000)?;
    plant.set("pid.mode", 2.0)?; // external setpoint
    plant.run(1)?;
    println!("back from manual: the output moved by {:.1} %", (plant.get("pid.out")? - before).abs());
    show(&plant, "and nothing was learnt meanwhile")
}
