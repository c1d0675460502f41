//! The face of glapp for a page in the browser.
//!
//! JavaScript puts numbers into memory that [`room`] gives it, and asks by [`ask`]: a request in JSON, an answer in JSON.
//! What can be asked is in [`Request`]. `page/engine.js` is the other side.

mod laboratory;
mod recording;
mod words;

use glapp_analysis::words::Reader;
use glapp_analysis::{Manual, StepTestSettings};
use laboratory::Laboratory;
use recording::Recording;
use serde::Deserialize;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::collections::HashMap;

/// A request.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Request {
    /// Begins the analysis of the recording whose columns are in memory, and gives the unit of OP.
    Begin {
        /// Facts known of its loop.
        task: glapp_analysis::Task,
        /// Unit of OP, where a person or the file states one.
        #[serde(default)]
        op_unit: Option<String>,
    },
    /// Goes on with so many rows.
    Rows {
        /// First row.
        from: usize,
        /// The row after the last.
        to: usize,
    },
    /// Cuts the problem into windows, and gives them; none where there is no problem.
    Windows,
    /// Fits a window by itself, and gives the result; needs no recording.
    Alone {
        /// One of those of [`Request::Windows`].
        window: Vec<u8>,
    },
    /// Fits, and gives the answer.
    Finish {
        /// Reader of the texts.
        reader: Reader,
    },
    /// Gives the answer, with what each of the windows says; what those say that are fitted so far, where some are not.
    Join {
        /// The answers of [`Request::Alone`], in the order of the windows; none of one that is not fitted yet.
        alone: Vec<Option<Vec<u8>>>,
        /// Reader of the texts.
        reader: Reader,
    },
    /// Puts something into words.
    Words(words::Asked),
    /// Reads the step test in the recording whose columns are in memory.
    StepTest {
        /// Rows made in manual.
        manual: Manual,
        /// Facts known of its loop.
        #[serde(default)]
        settings: StepTestSettings,
    },
    /// Begins a laboratory.
    Laboratory(laboratory::Project),
    /// Makes scans, and gives the recorded values of each.
    Run {
        /// Number of scans.
        scans: usize,
        /// `module.name` of the recorded values.
        record: Vec<String>,
    },
    /// The value of every variable of the laboratory, in the order of their names.
    Values,
    /// Sets a variable of the laboratory.
    Set {
        /// `module.name`.
        path: String,
        /// Value; none: the default.
        value: Option<f64>,
    },
}

/// All that is remembered from one request to the next.
#[derive(Default)]
struct Memory {
    /// Columns of numbers that JavaScript has filled, by their names.
    columns: HashMap<String, Vec<f64>>,
    recording: Option<Recording>,
    laboratory: Option<Laboratory>,
}

impl Memory {
    fn answer(&mut self, request: &str) -> Result<Value, String> {
        match serde_json::from_str(request).map_err(|error| error.to_string())? {
            Request::Begin { task, op_unit } => {
                let columns = std::mem::take(&mut self.columns);
                let (recording, unit) = Recording::begin(task, op_unit.as_deref(), columns)?;
                self.recording = Some(recording);
                Ok(json!(unit))
            }
            Request::Rows { from, to } => {
                self.recording.as_mut().ok_or("no recording was begun")?.rows(from..to).map(|()| Value::Null)
            }
            Request::Windows => self.recording.as_mut().ok_or("no recording was begun")?.windows(),
            Request::Alone { window } => recording::alone(&window),
            Request::Finish { reader } => self.recording.take().ok_or("no recording was begun")?.finish(&reader),
            Request::Join { alone, reader } => {
                self.recording.as_ref().ok_or("no recording was begun")?.join(&alone, &reader)
            }
            Request::Words(asked) => words::texts_of(asked),
            Request::StepTest { manual, settings } => {
                recording::step_test(manual, &settings, std::mem::take(&mut self.columns))
            }
            Request::Laboratory(project) => {
                let (laboratory, begun) = Laboratory::new(&project)?;
                self.laboratory = Some(laboratory);
                Ok(begun)
            }
            Request::Run { scans, record } => self.laboratory()?.run(scans, &record),
            Request::Values => self.laboratory()?.values(),
            Request::Set { path, value } => self.laboratory()?.set(&path, value),
        }
    }

    fn laboratory(&mut self) -> Result<&mut Laboratory, String> {
        self.laboratory.as_mut().ok_or_else(|| "no laboratory was begun".into())
    }
}

/// Answers a caller in Rust: a request in JSON, an answer in JSON, either `{"ok": ...}` or `{"error": "..."}`.
///
/// ```
/// let asked = r#"{"laboratory": {"h": 0.1, "modules": [["in", "Input", {"value": 2}], ["out", "Output", {}]],
///     "wires": ["in -> out"]}}"#;
/// assert!(glapp_page::answer(asked).starts_with(r#"{"ok":"#));
/// let run = glapp_page::answer(r#"{"run": {"scans": 2, "record": ["in.out"]}}"#);
/// assert_eq!(run, r#"{"ok":[[2.0,2.0]]}"#);
/// assert_eq!(glapp_page::answer(r#"{"step_test": {"manual": "all"}}"#), r#"{"error":"no column t"}"#);
/// let wrong = glapp_page::answer(r#"{"set": {"path": "in.size", "value": 1}}"#);
/// assert!(wrong.starts_with(r#"{"error":"in: there is no 'size' here"#));
/// ```
pub fn answer(request: &str) -> String {
    MEMORY
        .with_borrow_mut(|memory| match memory.answer(request) {
            Ok(found) => json!({ "ok": found }),
            Err(wrong) => json!({ "error": wrong }),
        })
        .to_string()
}

thread_local! {
    static MEMORY: RefCell<Memory> = RefCell::default();
    /// Exchanged text: a request, a name, an answer.
    static TEXT: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// The functions for JavaScript. Memory is reached by its address, and everything behind stays within the lengths given here.
#[allow(unsafe_code)]
mod exports {
    use super::{MEMORY, TEXT, answer};

    /// Room for a text of so many bytes, to be filled; gives its address.
    #[unsafe(no_mangle)]
    pub extern "C" fn text(bytes: usize) -> *mut u8 {
        TEXT.with_borrow_mut(|text| {
            text.clear();
            text.resize(bytes, 0);
            text.as_mut_ptr()
        })
    }

    /// Room for a column of so many numbers, to be filled, under the name that [`text`] has; gives its address.
    #[unsafe(no_mangle)]
    pub extern "C" fn room(numbers: usize) -> *mut f64 {
        let name = TEXT.with_borrow(|text| String::from_utf8_lossy(text).into_owned());
        MEMORY.with_borrow_mut(|memory| {
            let column = memory.columns.entry(name).or_default();
            *column = vec![f64::NAN; numbers];
            column.as_mut_ptr()
        })
    }

    /// Answers the request that [`text`] has; gives the bytes of the answer, which begins at [`answered`].
    #[unsafe(no_mangle)]
    pub extern "C" fn ask() -> usize {
        let request = TEXT.with_borrow(|text| String::from_utf8_lossy(text).into_owned());
        let reply = answer(&request).into_bytes();
        TEXT.with_borrow_mut(|text| {
            *text = reply;
            text.len()
        })
    }

    /// Address of the first byte of the answer, in the memory of WebAssembly.
    #[unsafe(no_mangle)]
    pub extern "C" fn answered() -> *const u8 {
        TEXT.with_borrow(|text| text.as_ptr())
    }
}
