//! The functions of `include/glapp.h`. `tests/test_c.py` holds the header to the signatures and structures that stand here.

use crate::errors::{BAD_LENGTH, BAD_POINTER, BAD_TEXT, CallError, OK, YES, guarded, text};
use crate::handles::Handles;
use crate::{ABI, settings};
use glapp_analysis::crossings::Row;
use glapp_analysis::words::{Message, text as sentence};
use glapp_analysis::{Analysis, Crossings, FitAnswer, FitVerdict, INSPECTED_ROWS, Inspected, ManualRows, fitted};
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO};
use glapp_fit::{Batch, LONG_HISTORY, Rows, Samples, Windows};
use glapp_sim::{Graph, Module};
use std::ffi::{CStr, c_char};
use std::ptr;

/// The longest text that is read.
const LONGEST: usize = 4096;
/// The greatest sum of the flags of a sample.
const ALL_FLAGS: u32 = (NOT_AUTO | BAD | AT_LOW | AT_HIGH) as u32;

static DETECTORS: Handles<Crossings> = Handles::new("detector");
static GRAPHS: Handles<Graph> = Handles::new("graph");

/// A detector, to C.
pub enum GlappDetector {}
/// A graph, to C.
pub enum GlappGraph {}

/// A name and its value.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappSetting {
    /// Name in the catalogue.
    pub name: *const c_char,
    /// Value in the unit of the catalogue.
    pub value: f64,
}

/// A module of a graph.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappModule {
    /// Name in the graph.
    pub name: *const c_char,
    /// Kind of the module.
    pub kind: *const c_char,
    /// Parameters.
    pub settings: *const GlappSetting,
    /// Number of parameters.
    pub count: usize,
}

/// One half-period, as Python's `HalfPeriod`. NaN where there is no such number.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappHalfPeriod {
    /// \[s\]
    pub t_start: f64,
    /// \[s\]
    pub t_end: f64,
    /// \[s\]
    pub delta_t: f64,
    /// [PV unit]
    pub delta_y: f64,
    /// [PV unit]
    pub e_max: f64,
    /// [PV unit]
    pub delta_sp: f64,
    /// [OP unit]
    pub delta_u: f64,
    /// [OP unit]
    pub op_travel: f64,
    /// [OP unit]
    pub d: f64,
    /// [OP unit]
    pub d_hat: f64,
    /// [OP unit]
    pub noise_floor: f64,
    /// Number of samples.
    pub samples: u32,
    /// Detections behind `d_hat`.
    pub detections: u32,
    /// All conditions that failed, one bit a reason.
    pub mask: u32,
    /// First reason of rejection; 0: accepted.
    pub reason: u32,
}

/// Estimate by the detections.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappEstimate {
    /// [OP unit]
    pub value: f64,
    /// [OP unit]
    pub low: f64,
    /// [OP unit]
    pub high: f64,
    /// [OP unit]; NaN where it is not known.
    pub noise_floor: f64,
    /// Detections in the window.
    pub count: u32,
    /// Number of detections within 80–120 % of their median.
    pub kept: u32,
}

/// Columns of a recording.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappColumns {
    /// Length of every column.
    pub rows: usize,
    /// \[s\]
    pub t: *const f64,
    /// [PV unit]; may be NULL.
    pub sp: *const f64,
    /// [PV unit]
    pub pv: *const f64,
    /// [OP unit]
    pub op: *const f64,
    /// Position of the valve [its unit]; may be NULL.
    pub position: *const f64,
    /// May be NULL.
    pub flags: *const u8,
}

/// Width of the gap with its 95 % interval. NaN where there is no such number.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GlappWidth {
    /// [OP unit]
    pub d: f64,
    /// [OP unit]
    pub low: f64,
    /// [OP unit]
    pub high: f64,
    /// [OP unit]
    pub jump: f64,
    /// 1
    pub lr_no_gap: f64,
    /// 1
    pub lr_needed: f64,
    /// [PV unit/OP unit]
    pub kp: f64,
    /// \[s\]
    pub dead_time: f64,
    /// \[s\]
    pub lag: f64,
    /// The process integrates.
    pub integrating: u32,
    /// Kind of lost motion.
    pub verdict: u32,
    /// Reason of the verdict.
    pub why: [c_char; 32],
}

// Inputs from C. -----------------------------------------------------------------------------------------------------

/// Checks a pointer: an error where it is NULL or not aligned for its type.
fn address<T>(at: *const T, name: &str) -> Result<(), CallError> {
    let what = if at.is_null() {
        "is NULL"
    } else if !at.is_aligned() {
        "does not lie as its type asks"
    } else {
        return Ok(());
    };
    Err(CallError::new(BAD_POINTER, format!("{name}: {what}")))
}

/// Checked pointer to the place of an answer.
fn place<T>(to: *mut T, name: &str) -> Result<*mut T, CallError> {
    address(to, name).map(|()| to)
}

/// An array; with no elements it may be NULL.
///
/// # Safety
/// What stands there is so long, and nobody writes to it meanwhile.
unsafe fn array<'a, T>(from: *const T, length: usize, name: &str) -> Result<&'a [T], CallError> {
    if length == 0 {
        return Ok(&[]);
    }
    address(from, name)?;
    let bytes = length.checked_mul(size_of::<T>()).filter(|bytes| *bytes <= isize::MAX as usize);
    if bytes.and_then(|bytes| from.addr().checked_add(bytes)).is_none() {
        return Err(CallError::new(BAD_LENGTH, format!("{name}: no array has {length} elements")));
    }
    // SAFETY: not NULL, aligned, within the address space; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(from, length) })
}

/// An array that may be NULL: it is not there.
///
/// # Safety
/// As [`array`].
unsafe fn maybe<'a, T>(from: *const T, length: usize, name: &str) -> Result<Option<&'a [T]>, CallError> {
    // SAFETY: as for the caller.
    if from.is_null() { Ok(None) } else { unsafe { array(from, length, name) }.map(Some) }
}

/// Reads a UTF-8 text that ends in a 0 byte.
///
/// # Safety
/// What stands there ends in a 0, or is [`LONGEST`] bytes long.
unsafe fn words<'a>(from: *const c_char, name: &str) -> Result<&'a str, CallError> {
    address(from, name)?;
    // SAFETY: nothing is read behind the first 0, nor behind the longest text.
    let length = (0..LONGEST).find(|at| unsafe { *from.add(*at) } == 0);
    let length =
        length.ok_or_else(|| CallError::new(BAD_TEXT, format!("{name}: has no end within {LONGEST} bytes")))?;
    // SAFETY: so many bytes were just read.
    let bytes = unsafe { array(from.cast::<u8>(), length, name) }?;
    std::str::from_utf8(bytes).map_err(|_| CallError::new(BAD_TEXT, format!("{name}: is no UTF-8")))
}

/// Names and values from a pointer and a length.
///
/// # Safety
/// As [`array`], and [`words`] for each name.
unsafe fn named<'a>(settings: *const GlappSetting, count: usize) -> Result<Vec<(&'a str, f64)>, CallError> {
    // SAFETY: as for the caller.
    let all = unsafe { array(settings, count, "settings") }?;
    // SAFETY: as for the caller.
    all.iter().map(|one| Ok((unsafe { words(one.name, "name of a setting") }?, one.value))).collect()
}

/// The columns of a recording.
struct Recorded<'a> {
    t: &'a [f64],
    sp: Option<&'a [f64]>,
    pv: &'a [f64],
    op: Option<&'a [f64]>,
    position: Option<&'a [f64]>,
    flags: Option<&'a [u8]>,
}

/// The columns, whose flags are known ones.
///
/// # Safety
/// As [`array`], for each of the columns.
unsafe fn recorded<'a>(columns: *const GlappColumns) -> Result<Recorded<'a>, CallError> {
    // SAFETY: as for the caller.
    let given = unsafe { array(columns, 1, "columns") }?[0];
    let rows = given.rows;
    // SAFETY: as for the caller.
    let must = |from, name| unsafe { array::<f64>(from, rows, name) };
    // SAFETY: as for the caller.
    let may = |from, name| unsafe { maybe::<f64>(from, rows, name) };
    // SAFETY: as for the caller.
    let flags = unsafe { maybe::<u8>(given.flags, rows, "flags") }?;
    for sum in flags.unwrap_or_default() {
        known((*sum).into())?;
    }
    Ok(Recorded {
        t: must(given.t, "t")?,
        sp: may(given.sp, "sp")?,
        pv: must(given.pv, "pv")?,
        op: may(given.op, "op")?,
        position: may(given.position, "position")?,
        flags,
    })
}

/// A sum of the flags of a sample.
fn known(flags: u32) -> Result<u8, CallError> {
    let sum = u8::try_from(flags).ok().filter(|_| flags <= ALL_FLAGS);
    sum.ok_or_else(|| {
        let what = "must be a sum of 1 (not in automatic), 2 (bad), 4 (OP at its low limit), 8 (at its high limit)";
        CallError::refused(format!("flags = {flags}: {what}"))
    })
}

/// PV without its bad values, as Python has it.
fn without_bad(pv: &[f64], flags: Option<&[u8]>) -> Vec<f64> {
    let bad = |k: usize| flags.is_some_and(|flags| flags[k] & BAD as u8 != 0);
    pv.iter().enumerate().map(|(k, pv)| if bad(k) { f64::NAN } else { *pv }).collect()
}

/// The flags, with rows that miss a setpoint which is recorded marked as bad, as Python does; none where no row misses it.
fn without_setpoint(sp: Option<&[f64]>, flags: Option<&[u8]>) -> Option<Vec<u8>> {
    let sp = sp.filter(|sp| sp.iter().any(|sp| sp.is_nan()))?;
    let mut marked = flags.map_or_else(|| vec![0; sp.len()], <[u8]>::to_vec);
    marked.iter_mut().zip(sp).filter(|(_, sp)| sp.is_nan()).for_each(|(flags, _)| *flags |= BAD as u8);
    Some(marked)
}

// The functions. -----------------------------------------------------------------------------------------------------------

/// The version of the interface that the library has.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_abi() -> u32 {
    ABI
}

/// The version of glapp.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    CStr::from_bytes_with_nul(VERSION.as_bytes()).unwrap_or_default().as_ptr()
}

/// The text of the last failure in this thread.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_error() -> *const c_char {
    text()
}

/// Makes a detector.
///
/// # Safety
/// Pointers lead to what the header says, of the length that is given.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_detector_new(
    settings: *const GlappSetting,
    count: usize,
    detector: *mut *mut GlappDetector,
) -> i32 {
    guarded(|| {
        let to = place(detector, "detector")?;
        // SAFETY: not NULL, aligned.
        unsafe { to.write(ptr::null_mut()) };
        // SAFETY: as for the caller.
        let given = unsafe { named(settings, count) }?;
        let made = Crossings::new(settings::detector(&given)?).map_err(CallError::refused)?;
        let number = DETECTORS.add(made)?;
        // SAFETY: not NULL, aligned.
        unsafe { to.write(ptr::without_provenance_mut(number)) };
        Ok(OK)
    })
}

/// Takes one sample; gives the half-period that it ended.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_detector_update(
    detector: *mut GlappDetector,
    t: f64,
    sp: f64,
    pv: f64,
    op: *const f64,
    flags: u32,
    ended: *mut GlappHalfPeriod,
) -> i32 {
    guarded(|| {
        let to = place(ended, "ended")?;
        // SAFETY: as for the caller.
        let op = unsafe { maybe(op, 1, "op") }?.map(|op| op[0]);
        let flags = known(flags)?;
        let row = DETECTORS.with(detector.addr(), |crossings| Ok(crossings.update(t, sp, pv, op, flags)))?;
        let Some(row) = row else { return Ok(OK) };
        // SAFETY: not NULL, aligned.
        unsafe { to.write(half_period(&row)) };
        Ok(YES)
    })
}

/// Estimate by the detections so far, if it is above the noise limit.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_detector_estimate(detector: *mut GlappDetector, estimate: *mut GlappEstimate) -> i32 {
    guarded(|| {
        let to = place(estimate, "estimate")?;
        let (shown, floor) = DETECTORS
            .with(detector.addr(), |crossings| Ok((crossings.state().shown(), crossings.state().noise_floor())))?;
        let Some(shown) = shown else { return Ok(OK) };
        let estimate = GlappEstimate {
            value: shown.value,
            low: shown.low,
            high: shown.high,
            noise_floor: floor.unwrap_or(f64::NAN),
            count: shown.count.into(),
            kept: shown.kept.into(),
        };
        // SAFETY: not NULL, aligned.
        unsafe { to.write(estimate) };
        Ok(YES)
    })
}

/// Frees a detector.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_detector_free(detector: *mut GlappDetector) -> i32 {
    guarded(|| DETECTORS.remove(detector.addr()).map(|()| OK))
}

/// Makes a graph of modules.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_graph_new(
    h: f64,
    modules: *const GlappModule,
    count: usize,
    wires: *const *const c_char,
    wire_count: usize,
    graph: *mut *mut GlappGraph,
) -> i32 {
    guarded(|| {
        let to = place(graph, "graph")?;
        // SAFETY: not NULL, aligned.
        unsafe { to.write(ptr::null_mut()) };
        // SAFETY: as for the caller.
        let given = unsafe { array(modules, count, "modules") }?;
        let mut made = Vec::with_capacity(given.len());
        for one in given {
            // SAFETY: as for the caller.
            let (name, kind) = unsafe { (words(one.name, "name of a module")?, words(one.kind, "kind of a module")?) };
            // SAFETY: as for the caller.
            let parameters = unsafe { named(one.settings, one.count) }?;
            let module = Module::new(kind, &parameters);
            made.push((name, module.map_err(|error| CallError::refused(format!("{name}: {error}")))?));
        }
        // SAFETY: as for the caller.
        let laid = unsafe { array(wires, wire_count, "wires") }?;
        // SAFETY: as for the caller.
        let laid = laid.iter().map(|wire| unsafe { words(*wire, "wire") }).collect::<Result<Vec<_>, _>>()?;
        let number = GRAPHS.add(Graph::new(h, made, &laid).map_err(CallError::refused)?)?;
        // SAFETY: not NULL, aligned.
        unsafe { to.write(ptr::without_provenance_mut(number)) };
        Ok(OK)
    })
}

/// One scan.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_graph_scan(graph: *mut GlappGraph, h: f64) -> i32 {
    guarded(|| {
        GRAPHS.with(graph.addr(), |graph| {
            graph.scan(h);
            Ok(OK)
        })
    })
}

/// Sets a parameter or variable while the graph runs.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_graph_set(graph: *mut GlappGraph, path: *const c_char, value: f64) -> i32 {
    guarded(|| {
        // SAFETY: as for the caller.
        let path = unsafe { words(path, "path") }?;
        GRAPHS.with(graph.addr(), |graph| graph.set(path, value).map(|()| OK).map_err(CallError::refused))
    })
}

/// Reads a parameter or variable while the graph runs.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_graph_get(graph: *mut GlappGraph, path: *const c_char, value: *mut f64) -> i32 {
    guarded(|| {
        let to = place(value, "value")?;
        // SAFETY: as for the caller.
        let path = unsafe { words(path, "path") }?;
        let found = GRAPHS.with(graph.addr(), |graph| graph.get(path).map_err(CallError::refused))?;
        // SAFETY: not NULL, aligned.
        unsafe { to.write(found) };
        Ok(OK)
    })
}

/// Frees a graph.
#[unsafe(no_mangle)]
pub extern "C" fn glapp_graph_free(graph: *mut GlappGraph) -> i32 {
    guarded(|| GRAPHS.remove(graph.addr()).map(|()| OK))
}

/// Fits the width of the gap to a recording.
///
/// # Safety
/// As [`glapp_detector_new`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_fit(columns: *const GlappColumns, sign: f64, width: *mut GlappWidth) -> i32 {
    guarded(|| {
        let to = place(width, "width")?;
        // SAFETY: as for the caller.
        let given = unsafe { recorded(columns) }?;
        if !(sign == 0.0 || sign.abs() == 1.0) {
            return Err(CallError::refused(format!("sign = {sign}: must be 1, -1, or 0 where it is not known")));
        }
        let Recorded { t, sp, pv, op, position, flags } = given;
        if op.is_none() && !t.is_empty() {
            return Err(CallError::new(BAD_POINTER, "op: is NULL"));
        }
        let marked = without_setpoint(sp, flags);
        let samples = Samples { t, pv, sp, op: Some(op.unwrap_or_default()), flags: marked.as_deref().or(flags) };
        let answer = fit(Batch { samples, position }, sign);
        // SAFETY: not NULL, aligned.
        unsafe { to.write(answer) };
        Ok(OK)
    })
}

/// Reads the step test in a recording; the answer is a text in JSON.
///
/// # Safety
/// As [`glapp_detector_new`]; `json` has room for so many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_step_test(
    columns: *const GlappColumns,
    settings: *const GlappSetting,
    count: usize,
    json: *mut c_char,
    room: usize,
    needed: *mut usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as for the caller.
        let given = unsafe { named(settings, count) }?;
        let (manual, settings) = settings::step_test(&given)?;
        // SAFETY: as for the caller.
        let given = unsafe { recorded(columns) }?;
        let Recorded { t, pv, op, position, flags, .. } = given;
        let pv = without_bad(pv, flags);
        let mut stretch = ManualRows::new(manual);
        stretch.take(&Inspected { t, sp: None, pv: &pv, op, flags }, position);
        let answer = serde_json::to_string(&stretch.read(&settings)).map_err(CallError::refused)?;
        // SAFETY: as for the caller.
        unsafe { hand_over(&answer, json, "json", room, needed) }
    })
}

/// Puts a message into a sentence; `reader` may be NULL.
///
/// # Safety
/// As [`glapp_detector_new`]; `text` has room for so many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_text(
    message: *const c_char,
    reader: *const c_char,
    text: *mut c_char,
    room: usize,
    needed: *mut usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as for the caller.
        let message: Message = json(unsafe { words(message, "message") }?, "message")?;
        // SAFETY: as for the caller.
        let reader = if reader.is_null() { "{}" } else { unsafe { words(reader, "reader") }? };
        let content =
            sentence(&message.code, &message.numbers, &json(reader, "reader")?).map_err(CallError::refused)?;
        // SAFETY: as for the caller.
        unsafe { hand_over(&content, text, "text", room, needed) }
    })
}

/// Parses a text of JSON.
fn json<'a, T: serde::Deserialize<'a>>(text: &'a str, name: &str) -> Result<T, CallError> {
    serde_json::from_str(text).map_err(|error| CallError::refused(format!("{name}: {error}")))
}

/// Analyses a recording; the answer document is a text in JSON.
///
/// # Safety
/// As [`glapp_detector_new`]; `json` has room for so many bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn glapp_analyze(
    columns: *const GlappColumns,
    task: *const c_char,
    json: *mut c_char,
    room: usize,
    needed: *mut usize,
) -> i32 {
    guarded(|| {
        // SAFETY: as for the caller.
        let task = unsafe { words(task, "task") }?;
        let task = serde_json::from_str(task).map_err(|error| CallError::refused(format!("task: {error}")))?;
        // SAFETY: as for the caller.
        let given = unsafe { recorded(columns) }?;
        let Recorded { t, sp, pv, op, position, flags } = given;
        let all = Inspected { t, sp, pv, op, flags };
        let beginning = position.map(|position| &position[..t.len().min(INSPECTED_ROWS)]);
        let begun = Analysis::new(task, &all.first(INSPECTED_ROWS), beginning);
        let mut analysis = begun.map_err(CallError::refused)?;
        analysis.take(&all, position);
        let answer = serde_json::to_string(&analysis.finish(&|_| ()).answer).map_err(CallError::refused)?;
        // SAFETY: as for the caller.
        unsafe { hand_over(&answer, json, "json", room, needed) }
    })
}

/// Writes a text to where the caller has room for it, and how many bytes it takes.
///
/// # Safety
/// `to` has room for so many bytes.
unsafe fn hand_over(
    content: &str,
    to: *mut c_char,
    name: &str,
    room: usize,
    needed: *mut usize,
) -> Result<i32, CallError> {
    let needs = place(needed, "needed")?;
    // SAFETY: not NULL, aligned.
    unsafe { needs.write(content.len() + 1) };
    if room <= content.len() {
        return Err(CallError::new(
            BAD_LENGTH,
            format!("{name}: has room for {room} bytes, must have {}", content.len() + 1),
        ));
    }
    let to = place(to, name)?;
    // SAFETY: not NULL, and with room for so many bytes, as the caller promises.
    unsafe {
        ptr::copy_nonoverlapping(content.as_ptr().cast::<c_char>(), to, content.len());
        to.add(content.len()).write(0);
    }
    Ok(OK)
}

// Outputs to C. ------------------------------------------------------------------------------------------------------

fn half_period(row: &Row) -> GlappHalfPeriod {
    let Row { span, record, .. } = row;
    let (half, parts) = (&record.half, &record.parts);
    GlappHalfPeriod {
        t_start: span.start,
        t_end: span.end,
        delta_t: half.delta_t,
        delta_y: half.delta_y,
        e_max: half.e_max,
        delta_sp: half.delta_sp,
        delta_u: parts.delta_u,
        op_travel: parts.op_travel,
        d: parts.d,
        d_hat: record.shown().map_or(f64::NAN, |shown| shown.value),
        noise_floor: record.noise_floor.unwrap_or(f64::NAN),
        samples: half.n,
        detections: record.estimate.map_or(0, |estimate| estimate.count.into()),
        mask: record.mask.into(),
        reason: record.reason() as u32,
    }
}

/// A recording as a whole, or the windows of a longer one.
fn fit(batch: Batch, sign: f64) -> GlappWidth {
    let Samples { t, pv, sp, op, flags } = batch.samples;
    if t.len() < LONG_HISTORY {
        return width_of(&fitted(&[batch], sign, None, &|_| ()).answer);
    }
    let first = ..LONG_HISTORY;
    let beginning = Samples {
        t: &t[first],
        pv: &pv[first],
        sp: sp.map(|sp| &sp[first]),
        op: op.map(|op| &op[first]),
        flags: flags.map(|flags| &flags[first]),
    };
    let mut windows = Windows::of_history(&beginning, sign);
    windows.add(&batch);
    let best: Vec<Batch> = windows.best().map(Rows::batch).collect();
    width_of(&fitted(&best, sign, None, &|_| ()).answer)
}

fn width_of(answer: &FitAnswer) -> GlappWidth {
    let number = |x: Option<f64>| x.unwrap_or(f64::NAN);
    let process = answer.process;
    let mut why = [0; 32];
    // A word is shorter, and ends in a 0.
    for (to, byte) in why[..31].iter_mut().zip(answer.word().bytes()) {
        *to = byte as c_char;
    }
    let verdict = FitVerdict::ALL.iter().position(|one| *one == answer.verdict).unwrap_or(FitVerdict::ALL.len() - 1);
    GlappWidth {
        d: number(answer.d),
        low: number(answer.low),
        high: number(answer.high),
        jump: answer.jump,
        lr_no_gap: number(answer.lr_no_gap),
        lr_needed: number(answer.lr_needed),
        kp: number(process.map(|process| process.kp.0)),
        dead_time: number(process.map(|process| process.dead_time.0)),
        lag: number(process.map(|process| process.lag.0)),
        integrating: process.is_some_and(|process| process.integrating).into(),
        verdict: verdict as u32 + 1,
        why,
    }
}
