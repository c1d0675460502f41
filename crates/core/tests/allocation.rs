//! A scan does not touch the heap.

use glapp_core::auto_tuner::Phase;
use glapp_core::modules::{
    Gains, Mode, PidAdvanced, PidAdvancedSettings, PidAdvancedState, ProcessSim, ProcessSimState, SCHEDULE_ROWS,
};
use glapp_core::{AutoTuner, AutoTunerState, Backlash, BacklashState, Backward, Noise, NoiseState};

#[path = "../../../bench/settings.rs"]
mod settings;

#[test]
fn a_loop_of_modules_scans_without_allocation() {
    let mut schedule = [Gains::default(); SCHEDULE_ROWS];
    schedule[0] = Gains { at: 0.0, k: 2.0, ti: 2.0, td: 0.0 };
    schedule[1] = Gains { at: 100.0, k: 2.5, ti: 2.0, td: 0.0 };
    let advanced = settings::controller();
    let scheduled = PidAdvancedSettings { schedule, rows: 2, ..advanced };
    let tuned = PidAdvancedSettings { tuner: Some(settings::experiment()), ..advanced };
    for settings in [advanced, scheduled, tuned] {
        let pid = PidAdvanced::new(settings).unwrap();
        let mut state = PidAdvancedState::at(50.0);
        (state.pid.mode, state.detection.compensate) = (Mode::External, true);
        let (gap, noise) = (Backlash::new(2.0).unwrap(), Noise::new(0.1).unwrap());
        let process = ProcessSim::<f64, 16>::new(1.0, 3.0, 1.0, 0.0, 0.1).unwrap();
        let (mut position, mut integer) = (BacklashState::default(), NoiseState::default());
        let mut lags = ProcessSimState::at_rest(50.0);
        let mut saw_u_ff = false;
        let counted = allocation_counter::measure(|| {
            for k in 0..20_000 {
                let pv = noise.forward(&mut integer, process.output(&lags));
                state.tuner.run |= settings.tuner.is_some() && k == 100;
                // A sensor that fails now and then, a person who takes over.
                let pv = if k % 5000 == 77 { f64::NAN.into() } else { pv };
                state.pid.mode = if k % 9000 > 8900 { Mode::Manual } else { Mode::External };
                let u = pid.forward(&mut state, pv, 50.0.into(), 0.0.into(), pv, 0.1);
                let x = gap.forward(&mut position, u);
                process.forward(&mut lags, x, 5.0.into());
                pid.backward(&mut state, Backward::default());
                saw_u_ff |= state.detection.compensation.u_ff != 0.0;
            }
        });
        assert!(saw_u_ff && state.detection.detector.accepted() > 5, "{}", state.detection.detector.accepted());
        assert_eq!(state.tuner.experiment.cycles > 2, settings.tuner.is_some());
        assert_eq!(counted.count_total, 0);
    }
    // The count counts.
    assert_eq!(allocation_counter::measure(|| drop(std::hint::black_box(vec![1.0; 9]))).count_total, 1);
}

#[test]
fn a_relay_experiment_runs_without_allocation() {
    let tuner = AutoTuner::new(settings::experiment()).unwrap();
    let process = ProcessSim::<f64, 16>::new(1.0, 3.0, 1.0, 1.0, 0.1).unwrap();
    let (mut lags, mut state) = (ProcessSimState::at_rest(50.0), AutoTunerState::default());
    let counted = allocation_counter::measure(|| {
        tuner.start(&mut state, 50.0);
        while state.phase.is_running() {
            let op = tuner.update(&mut state, process.output(&lags).value, 0.1, 0);
            process.forward(&mut lags, op.into(), 0.0.into());
        }
    });
    assert_eq!((state.phase, counted.count_total), (Phase::Done, 0));
}
