//! Functions that C calls. Each checks its pointers and that the memory holds what it is told to hold, and follows nothing else.

use core::mem::{align_of, size_of};
use glapp_core::modules::{self, Mode, PidSettings};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO};
use glapp_core::{
    Backward, Compensation, CompensationSample, CompensationSettings, CompensationState, Detector, DetectorSettings,
    DetectorState, Forward, ParameterError, Sample, Saturation, Source, Way,
};

/// All is well.
pub const OK: i32 = 0;
/// A pointer is null, or not aligned.
pub const BAD_POINTER: i32 = -1;
/// The memory was not made by the function that begins a block of this kind.
pub const NOT_BEGUN: i32 = -2;

/// Bytes that the header gives each kind, in `f32` and in `f64`.
pub const DETECTOR: (usize, usize) = (800, 1472);
/// Likewise of a compensation.
pub const COMPENSATION: (usize, usize) = (512, 768);
/// Likewise of a PID.
pub const PID: (usize, usize) = (384, 512);

/// Flags that C may hand over; others are ignored.
const KNOWN_FLAGS: u32 = (NOT_AUTO | BAD | AT_LOW | AT_HIGH) as u32;

/// Both limits of OP, or none; the number of the one that is missing beside the other.
fn limits<R: glapp_core::Real>(
    low: Option<R>,
    high: Option<R>,
    names: [&'static str; 2],
) -> Result<Option<(R, R)>, i32> {
    let missing = match (low, high) {
        (Some(low), Some(high)) => return Ok(Some((low, high))),
        (None, None) => return Ok(None),
        (low, _) => names[usize::from(low.is_some())],
    };
    Err(ParameterError { name: missing, value: f64::NAN, bound: "given beside the other limit" }
        .number()
        .map_or(i32::MAX, i32::from))
}

/// A block with its state, and a mark by which it is known.
#[repr(C, align(8))]
struct Held<B, S> {
    mark: u32,
    block: B,
    state: S,
}

/// Value at the pointer; an error where it is null or not aligned.
///
/// # Safety
/// A pointer that is not null and aligned points to memory of that type, which nobody else uses meanwhile.
unsafe fn at<'a, T>(pointer: *mut T) -> Result<&'a mut T, i32> {
    if pointer.is_null() || !pointer.is_aligned() {
        return Err(BAD_POINTER);
    }
    // SAFETY: as the function asks.
    Ok(unsafe { &mut *pointer })
}

/// Puts a block into memory that C gives.
///
/// # Safety
/// As of [`at`]; the memory need not hold anything yet.
unsafe fn begin<B, S>(memory: *mut u64, mark: u32, block: B, state: S) -> i32 {
    if memory.is_null() || !memory.is_aligned() {
        return BAD_POINTER;
    }
    // SAFETY: the memory is as large as the header says, which is held to the size of this below.
    unsafe { memory.cast::<Held<B, S>>().write(Held { mark, block, state }) };
    OK
}

/// A block that was put there.
///
/// # Safety
/// As of [`at`].
unsafe fn held<'a, B, S>(memory: *mut u64, mark: u32) -> Result<&'a mut Held<B, S>, i32> {
    // SAFETY: the first word is the mark of any block, or whatever the memory held before one was begun.
    let first = unsafe { at(memory.cast::<u32>()) }?;
    if !memory.is_aligned() {
        return Err(BAD_POINTER);
    }
    if *first != mark {
        return Err(NOT_BEGUN);
    }
    // SAFETY: only `begin` writes this mark, and with it a block of this kind.
    unsafe { at(memory.cast::<Held<B, S>>()) }
}

macro_rules! faces {
    ($module:ident, $float:ty, $bytes:tt, $mark:expr, $detector_defaults:ident, $detector_begin:ident, $detector_update:ident,
     $detector_estimate:ident, $compensation_defaults:ident, $compensation_begin:ident, $compensation_update:ident,
     $pid_defaults:ident, $pid_begin:ident, $pid_update:ident, $pid_told:ident) => {
        /// The blocks in one precision.
        pub mod $module {
            use super::*;

            type OfDetector = Held<Detector<$float>, DetectorState<$float>>;
            /// With whether it has been seen off: what is on from the start does not begin by itself after a power cut.
            type OfCompensation = Held<Compensation<$float>, (CompensationState<$float>, bool)>;
            type OfPid = Held<modules::Pid<$float>, modules::PidState<$float>>;

            const _: () = assert!(size_of::<OfDetector>() <= DETECTOR.$bytes && align_of::<OfDetector>() <= 8);
            const _: () = assert!(size_of::<OfCompensation>() <= COMPENSATION.$bytes);
            const _: () = assert!(size_of::<OfPid>() <= PID.$bytes);
            const DETECTOR_MARK: u32 = 0x6764_0000 + $mark;
            const COMPENSATION_MARK: u32 = 0x6763_0000 + $mark;
            const PID_MARK: u32 = 0x6770_0000 + $mark;

            /// Bytes that a detector, a compensation and a PID need here.
            pub const NEEDED: [usize; 3] = [size_of::<OfDetector>(), size_of::<OfCompensation>(), size_of::<OfPid>()];

            /// Settings of a detector, as in the header; an unknown one is no number.
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            #[allow(missing_docs)]
            pub struct DetectorGiven {
                pub k: $float,
                pub ti: $float,
                pub td: $float,
                pub b: $float,
                pub kp: $float,
                pub pv_span: $float,
                pub op_span: $float,
                pub op_low: $float,
                pub op_high: $float,
                pub tf: $float,
                pub max_h: $float,
                pub n: u32,
                pub integrating: u32,
            }

            /// Estimate of a detector.
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            #[allow(missing_docs)]
            pub struct Estimated {
                pub width: $float,
                pub low: $float,
                pub high: $float,
                pub noise_floor: $float,
                pub count: u32,
                pub accepted: u32,
            }

            /// Settings of a compensation.
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            #[allow(missing_docs)]
            pub struct CompensationGiven {
                pub k: $float,
                pub ti: $float,
                pub size: $float,
                pub share: $float,
                pub limit: $float,
                pub band: $float,
                pub tf: $float,
                pub rate: $float,
                pub release: $float,
                pub travel: $float,
                pub reversals: $float,
                pub watch: $float,
                pub op_low: $float,
                pub op_high: $float,
                pub way: u32,
                pub withdraw: u32,
                pub use_estimate: u32,
            }

            /// Settings of a PID.
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq)]
            #[allow(missing_docs)]
            pub struct PidGiven {
                pub k: $float,
                pub ti: $float,
                pub td: $float,
                pub b: $float,
                pub c: $float,
                pub tf: $float,
                pub low: $float,
                pub high: $float,
                pub rate: $float,
                pub max_h: $float,
            }

            /// A number from C, where NaN means not known.
            fn known(x: $float) -> Option<$float> {
                if x.is_nan() { None } else { Some(x) }
            }

            /// Settings with the defaults for a controller and a sample time.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $detector_defaults(
                k: $float,
                ti: $float,
                td: $float,
                h: $float,
                given: *mut DetectorGiven,
            ) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let given = match unsafe { at(given) } {
                    Ok(given) => given,
                    Err(code) => return code,
                };
                let s = DetectorSettings::new(k, ti, td, h);
                let none = <$float>::NAN;
                *given = DetectorGiven {
                    k,
                    ti,
                    td,
                    b: s.b,
                    kp: none,
                    pv_span: none,
                    op_span: none,
                    op_low: none,
                    op_high: none,
                    tf: s.tf,
                    max_h: s.max_h,
                    n: s.n,
                    integrating: 0,
                };
                OK
            }

            /// Begins a detector.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $detector_begin(memory: *mut u64, given: *mut DetectorGiven) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let g = match unsafe { at(given) } {
                    Ok(given) => *given,
                    Err(code) => return code,
                };
                let usual = DetectorSettings::new(g.k, g.ti, g.td, 1.0);
                let op_limits = match limits(known(g.op_low), known(g.op_high), ["op_low", "op_high"]) {
                    Ok(limits) => limits,
                    Err(number) => return number,
                };
                let settings = DetectorSettings {
                    td: known(g.td),
                    b: g.b,
                    kp: known(g.kp),
                    pv_span: known(g.pv_span),
                    op_span: known(g.op_span),
                    op_limits,
                    tf: g.tf,
                    max_h: g.max_h,
                    n: g.n,
                    integrating: g.integrating != 0,
                    ..usual
                };
                match Detector::of(&settings) {
                    // SAFETY: as the header says of the memory.
                    Ok(block) => unsafe { begin(memory, DETECTOR_MARK, block, DetectorState::<$float>::default()) },
                    Err(error) => error.number().map_or(i32::MAX, i32::from),
                }
            }

            /// Takes a sample.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $detector_update(
                memory: *mut u64,
                h: $float,
                sp: $float,
                pv: $float,
                op: $float,
                flags: u32,
            ) -> i32 {
                // SAFETY: as the header says of the memory.
                let one: &mut OfDetector = match unsafe { held(memory, DETECTOR_MARK) } {
                    Ok(one) => one,
                    Err(code) => return code,
                };
                let sample = Sample { h, sp, pv, op: known(op), flags: (flags & KNOWN_FLAGS) as u16 };
                i32::from(one.block.update(&mut one.state, &sample).is_some())
            }

            /// Estimate by the detections.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $detector_estimate(memory: *mut u64, shown: *mut Estimated) -> i32 {
                // SAFETY: as the header says of the memory, and of what is shown.
                let (one, shown) = match unsafe { (held(memory, DETECTOR_MARK), at(shown)) } {
                    (Ok(one), Ok(shown)) => (one as &mut OfDetector, shown),
                    (Err(code), _) | (_, Err(code)) => return code,
                };
                let (none, state) = (<$float>::NAN, &one.state);
                *shown = Estimated { width: none, low: none, high: none, ..Estimated::default() };
                (shown.noise_floor, shown.accepted) = (state.noise_floor().unwrap_or(none), state.accepted());
                if let Some(estimate) = state.estimate() {
                    (shown.width, shown.low, shown.high) = (estimate.value, estimate.low, estimate.high);
                    shown.count = estimate.count.into();
                }
                i32::from(state.shown().is_some())
            }

            /// Settings with the defaults.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $compensation_defaults(
                k: $float,
                ti: $float,
                size: $float,
                given: *mut CompensationGiven,
            ) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let given = match unsafe { at(given) } {
                    Ok(given) => given,
                    Err(code) => return code,
                };
                let s = CompensationSettings::new(Way::Inverse, k, ti, size, 1.0);
                *given = CompensationGiven {
                    k,
                    ti,
                    size,
                    share: s.share,
                    limit: s.limit,
                    band: s.band,
                    tf: s.tf,
                    rate: s.rate,
                    release: s.release,
                    travel: s.travel,
                    reversals: s.reversals,
                    watch: s.watch,
                    op_low: <$float>::NAN,
                    op_high: <$float>::NAN,
                    way: s.way as u32,
                    withdraw: 1,
                    use_estimate: 1,
                };
                OK
            }

            /// Begins a compensation, which is off.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $compensation_begin(memory: *mut u64, given: *mut CompensationGiven) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let g = match unsafe { at(given) } {
                    Ok(given) => *given,
                    Err(code) => return code,
                };
                let number = |error: glapp_core::ParameterError| error.number().map_or(i32::MAX, i32::from);
                let Some(way) = Way::ALL.into_iter().find(|way| *way as u32 == g.way) else { return 44 };
                let limits = match limits(known(g.op_low), known(g.op_high), ["low", "high"]) {
                    Ok(Some((low, high))) => match Saturation::new(low, high) {
                        Ok(limits) => limits,
                        Err(error) => return number(error),
                    },
                    Ok(None) => Saturation::none(),
                    Err(number) => return number,
                };
                let settings = CompensationSettings {
                    source: Source::Typed,
                    share: g.share,
                    limit: g.limit,
                    band: g.band,
                    tf: g.tf,
                    rate: g.rate,
                    release: g.release,
                    travel: g.travel,
                    reversals: g.reversals,
                    watch: g.watch,
                    withdraw: g.withdraw != 0,
                    estimate: g.use_estimate != 0,
                    limits,
                    ..CompensationSettings::new(way, g.k, g.ti, g.size, g.share)
                };
                match Compensation::new(settings) {
                    // SAFETY: as the header says of the memory.
                    Ok(block) => unsafe {
                        begin(memory, COMPENSATION_MARK, block, (CompensationState::<$float>::default(), false))
                    },
                    Err(error) => number(error),
                }
            }

            /// Takes a sample; u_FF goes to `u_ff`.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            #[allow(clippy::too_many_arguments)]
            pub unsafe extern "C" fn $compensation_update(
                memory: *mut u64,
                h: $float,
                e: $float,
                u: $float,
                d_hat: $float,
                enable: u32,
                flags: u32,
                u_ff: *mut $float,
            ) -> i32 {
                // SAFETY: as the header says of the memory, and of the number.
                let (one, u_ff) = match unsafe { (held(memory, COMPENSATION_MARK), at(u_ff)) } {
                    (Ok(one), Ok(u_ff)) => (one as &mut OfCompensation, u_ff),
                    (Err(code), _) | (_, Err(code)) => return code,
                };
                let (state, seen_off) = &mut one.state;
                *seen_off |= enable == 0;
                let sample = CompensationSample {
                    e,
                    u,
                    h,
                    d_hat: known(d_hat),
                    enable: enable != 0 && *seen_off,
                    flags: (flags & KNOWN_FLAGS) as u16,
                    ..CompensationSample::default()
                };
                *u_ff = one.block.update(state, &sample);
                state.standing as i32
            }

            /// Settings with the defaults.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $pid_defaults(k: $float, ti: $float, td: $float, given: *mut PidGiven) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let given = match unsafe { at(given) } {
                    Ok(given) => given,
                    Err(code) => return code,
                };
                let s = PidSettings::ideal(k, ti, td);
                let (low, high, rate) = (s.low, s.high, s.rate);
                *given = PidGiven { k, ti, td, b: s.b, c: s.c, tf: s.tf, low, high, rate, max_h: s.max_h };
                OK
            }

            /// Begins a PID in automatic, its output at `start`.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $pid_begin(memory: *mut u64, given: *mut PidGiven, start: $float) -> i32 {
                // SAFETY: C hands over settings, or nothing.
                let g = match unsafe { at(given) } {
                    Ok(given) => *given,
                    Err(code) => return code,
                };
                let settings = PidSettings {
                    b: g.b,
                    c: g.c,
                    tf: g.tf,
                    low: g.low,
                    high: g.high,
                    rate: g.rate,
                    max_h: g.max_h,
                    ..PidSettings::ideal(g.k, g.ti, g.td)
                };
                match modules::Pid::new(settings) {
                    // SAFETY: as the header says of the memory.
                    Ok(block) => unsafe { begin(memory, PID_MARK, block, modules::PidState::at(start)) },
                    Err(error) => error.number().map_or(i32::MAX, i32::from),
                }
            }

            /// One scan forward; the output goes to `output`.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            #[allow(clippy::too_many_arguments)]
            pub unsafe extern "C" fn $pid_update(
                memory: *mut u64,
                h: $float,
                sp: $float,
                pv: $float,
                ff: $float,
                manual: $float,
                mode: u32,
                output: *mut $float,
            ) -> i32 {
                // SAFETY: as the header says of the memory, and of the number.
                let (one, output) = match unsafe { (held(memory, PID_MARK), at(output)) } {
                    (Ok(one), Ok(output)) => (one as &mut OfPid, output),
                    (Err(code), _) | (_, Err(code)) => return code,
                };
                let state = &mut one.state;
                if let Some(mode) = Mode::ALL.get(mode as usize) {
                    state.mode = *mode;
                }
                if let Some(manual) = known(manual) {
                    state.manual = manual;
                }
                state.sp = sp;
                *output = one.block.forward(state, Forward::from(pv), Forward::from(sp), Forward::from(ff), h).value;
                OK
            }

            /// Takes the backward signals of the part after it; gives the flags for a detector beside it.
            ///
            /// # Safety
            /// As the header says.
            #[unsafe(no_mangle)]
            pub unsafe extern "C" fn $pid_told(memory: *mut u64, flags: u32, tracking: $float) -> i32 {
                // SAFETY: as the header says of the memory.
                let one: &mut OfPid = match unsafe { held(memory, PID_MARK) } {
                    Ok(one) => one,
                    Err(code) => return code,
                };
                let back = Backward { flags: (flags & KNOWN_FLAGS) as u16, tracking, ..Backward::default() };
                one.block.backward(&mut one.state, back);
                i32::from(one.state.flags | one.state.error & BAD)
            }
        }
    };
}

faces!(
    single,
    f32,
    0,
    32,
    glapp_detector_defaults_f32,
    glapp_detector_begin_f32,
    glapp_detector_update_f32,
    glapp_detector_estimate_f32,
    glapp_compensation_defaults_f32,
    glapp_compensation_begin_f32,
    glapp_compensation_update_f32,
    glapp_pid_defaults_f32,
    glapp_pid_begin_f32,
    glapp_pid_update_f32,
    glapp_pid_told_f32
);
faces!(
    double,
    f64,
    1,
    64,
    glapp_detector_defaults_f64,
    glapp_detector_begin_f64,
    glapp_detector_update_f64,
    glapp_detector_estimate_f64,
    glapp_compensation_defaults_f64,
    glapp_compensation_begin_f64,
    glapp_compensation_update_f64,
    glapp_pid_defaults_f64,
    glapp_pid_begin_f64,
    glapp_pid_update_f64,
    glapp_pid_told_f64
);
