//! Fuzzing of the functions of the C library with all inputs that C may give: no panic, no code that the header does
//! not know, and no output beyond the header's.
//!
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run capi -- -max_total_time=180`
#![no_main]

mod bytes;

use bytes::Bytes;
use glapp::*;
use libfuzzer_sys::fuzz_target;
use std::ffi::{CStr, CString, c_char};
use std::ptr;

impl Bytes<'_> {
    /// Small steps mostly, and now and then all that a double can be.
    fn number(&mut self) -> Option<f64> {
        Some(match self.byte()? {
            kind @ 0..=219 => f64::from(i16::from(kind) - 60) / 8.0,
            _ => self.double()?,
        })
    }

    /// A name that is known, or any text.
    fn name(&mut self, known: &[&str]) -> Option<CString> {
        let at = usize::from(self.byte()?);
        if let Some(name) = known.get(at) {
            return CString::new(*name).ok();
        }
        let length = (at % 8).min(self.0.len());
        let (text, rest) = self.0.split_at(length);
        self.0 = rest;
        CString::new(text.iter().copied().filter(|byte| *byte != 0).collect::<Vec<_>>()).ok()
    }

    fn settings(&mut self, known: &[&str]) -> Option<Vec<(CString, f64)>> {
        let count = self.byte()? % 12;
        (0..count).map(|_| Some((self.name(known)?, self.number()?))).collect()
    }
}

/// The codes of the header; each failure has a text.
fn checked(code: i32) -> i32 {
    assert!((BAD_TEXT..=YES).contains(&code) || code == REFUSED, "{code}: {:?}", text());
    if code < 0 {
        assert!(!text().to_bytes().is_empty());
    }
    code
}

fn text() -> &'static CStr {
    // SAFETY: it is good until the next failure in this thread.
    unsafe { CStr::from_ptr(glapp_error()) }
}

fn of(settings: &[(CString, f64)]) -> Vec<GlappSetting> {
    settings.iter().map(|(name, value)| GlappSetting { name: name.as_ptr(), value: *value }).collect()
}

const DETECTOR: [&str; 21] = [
    "k", "ti", "h", "td", "b", "kp", "pv_span", "op_span", "integrating", "tf", "n", "max_h", "op_low", "op_high",
    "limits", "too_short", "not_square", "decaying", "growing", "sp_moved", "too_small",
];
const PARAMETERS: [&str; 12] =
    ["k", "ti", "td", "value", "d", "gain", "t1", "t2", "low", "high", "comp_size", "tune_amplitude"];
const KINDS: [&str; 8] =
    ["Input", "Output", "PidAdvanced", "Backlash", "ProcessSim", "Noise", "BacklashDetection", "Plant"];
const WIRES: [&str; 5] = ["a -> b.pv", "b -> c -> d -> b.pv", "a -> b.sp", "a -> b", "b -> c"];
const PATHS: [&str; 8] = ["a.value", "b.k", "b.compensate", "b.d_hat", "b.mode", "b", "c.d", "d.dead_time"];

/// One call; none where the bytes are at their end.
fn call(bytes: &mut Bytes, detector: &mut *mut GlappDetector, graph: &mut *mut GlappGraph) -> Option<()> {
    // SAFETY: every pointer is NULL, misaligned, or leads to what lives here for the call.
    unsafe {
        match bytes.byte()? % 10 {
            0 => {
                let settings = bytes.settings(&DETECTOR)?;
                glapp_detector_free(*detector);
                checked(glapp_detector_new(of(&settings).as_ptr(), settings.len(), detector));
            }
            1 => {
                let typical = [("k", 0.5), ("ti", 2.0), ("h", 1.0)];
                let settings = typical.map(|(name, value)| (CString::new(name).unwrap(), value));
                glapp_detector_free(*detector);
                assert_eq!(checked(glapp_detector_new(of(&settings).as_ptr(), 3, detector)), OK);
            }
            2..=4 => {
                let (op, flags) = (bytes.number()?, u32::from(bytes.byte()? % 18));
                let op_at = if flags % 3 == 0 { ptr::null() } else { &raw const op };
                let mut ended = std::mem::zeroed::<GlappHalfPeriod>();
                let (t, sp, pv) = (bytes.number()?, bytes.number()?, bytes.number()?);
                if checked(glapp_detector_update(*detector, t, sp, pv, op_at, flags, &mut ended)) == YES {
                    assert!(ended.samples > 0 && ended.delta_t >= 0.0 && ended.d.is_finite() && ended.mask < 1 << 9);
                }
                let mut estimate = std::mem::zeroed::<GlappEstimate>();
                if checked(glapp_detector_estimate(*detector, &mut estimate)) == YES {
                    assert!(estimate.value.is_finite() && estimate.kept <= estimate.count);
                }
            }
            5 => {
                let (kinds, names) =
                    (bytes.byte()? % 6, ["a", "b", "c", "d", "e", "a"].map(|n| CString::new(n).unwrap()));
                let mut made = Vec::new();
                for _ in 0..kinds {
                    made.push((bytes.name(&KINDS)?, bytes.settings(&PARAMETERS)?));
                }
                let lists: Vec<Vec<GlappSetting>> = made.iter().map(|(_, settings)| of(settings)).collect();
                let modules: Vec<GlappModule> = made
                    .iter()
                    .zip(&lists)
                    .zip(&names)
                    .map(|(((kind, _), list), name)| GlappModule {
                        name: name.as_ptr(),
                        kind: kind.as_ptr(),
                        settings: list.as_ptr(),
                        count: list.len(),
                    })
                    .collect();
                let count = bytes.byte()? % 4;
                let wires = (0..count).map(|_| bytes.name(&WIRES)).collect::<Option<Vec<_>>>()?;
                let wires: Vec<*const c_char> = wires.iter().map(|wire| wire.as_ptr()).collect();
                glapp_graph_free(*graph);
                let h = bytes.number()?;
                checked(glapp_graph_new(h, modules.as_ptr(), modules.len(), wires.as_ptr(), wires.len(), graph));
            }
            6 => {
                checked(glapp_graph_scan(*graph, bytes.number()?));
            }
            7 => {
                let path = bytes.name(&PATHS)?;
                checked(glapp_graph_set(*graph, path.as_ptr(), bytes.number()?));
                checked(glapp_graph_get(*graph, path.as_ptr(), &mut 0.0));
            }
            8 => {
                // Handles of the other kind, freed ones, and any number.
                let any = ptr::without_provenance_mut(usize::from(bytes.byte()?) * 8);
                checked(glapp_graph_scan((*detector).cast(), 1.0));
                checked(glapp_detector_estimate(any, ptr::null_mut()));
                let bad = ptr::without_provenance_mut::<f64>(3);
                assert_eq!(checked(glapp_graph_get(*graph, c"a".as_ptr(), bad)), BAD_POINTER);
                assert_eq!(checked(glapp_graph_set(*graph, ptr::null(), 1.0)), BAD_POINTER);
                let one = GlappSetting { name: c"k".as_ptr(), value: 1.0 };
                assert_eq!(checked(glapp_detector_new(&one, usize::MAX, detector)), BAD_LENGTH);
            }
            _ => {
                let rows = usize::from(bytes.byte()? % 80);
                let mut columns = [const { Vec::new() }; 4];
                for _ in 0..rows {
                    for column in &mut columns {
                        column.push(bytes.number()?);
                    }
                }
                let [t, sp, pv, op] = columns.each_ref().map(|column| column.as_ptr());
                let given = GlappColumns { rows, t, sp, pv, op, position: ptr::null(), flags: ptr::null() };
                let mut width = std::mem::zeroed::<GlappWidth>();
                let manual = GlappSetting { name: c"manual".as_ptr(), value: 1.0 };
                let (mut json, mut needed) = (vec![1; 65_536], 0);
                let told = glapp_step_test(&given, &manual, 1, json.as_mut_ptr(), json.len(), &mut needed);
                assert!(checked(told) != OK || json[needed - 1] == 0);
                if checked(glapp_fit(&given, bytes.number()?, &mut width)) == OK {
                    assert!((1..=7).contains(&width.verdict) && width.why[0] != 0 && width.why[31] == 0);
                }
            }
        }
    }
    Some(())
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes(data);
    let (mut detector, mut graph) = (ptr::null_mut(), ptr::null_mut());
    while call(&mut bytes, &mut detector, &mut graph).is_some() {}
    glapp_detector_free(detector);
    glapp_graph_free(graph);
});
