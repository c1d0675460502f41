//! A recording on its way to an answer.

use glapp_analysis::crossings::Row;
use glapp_analysis::quality::{Finding, PERCENT, op_unit};
use glapp_analysis::words::{self, AnswerFacts, Reader, TextError};
use glapp_analysis::{
    Analysis, Crossings, Done, INSPECTED_ROWS, Inspected, Manual, ManualRows, StepTestSettings, Task,
};
use glapp_fit::{Divided, JointAnswer, PositionAnswer, SegmentAnswer, SegmentFit, Window, WindowFit};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::ops::Range;

/// A recording: its columns as the page has read them, and its analysis.
pub(crate) struct Recording {
    columns: Columns,
    analysis: Analysis,
    /// Width of OP's span, where it is known [OP unit].
    span: Option<f64>,
    /// Problem to fit, where it was asked for.
    divided: Option<Divided>,
}

struct Columns {
    t: Vec<f64>,
    sp: Option<Vec<f64>>,
    pv: Vec<f64>,
    op: Option<Vec<f64>>,
    position: Option<Vec<f64>>,
    flags: Option<Vec<u8>>,
    /// Sum of each row's marks ([`glapp_analysis::MARKED_PV`]).
    marks: Option<Vec<u8>>,
}

impl Columns {
    /// The columns by their names, once they are seen to be of one length.
    fn of(mut columns: HashMap<String, Vec<f64>>) -> Result<Self, String> {
        let mut column = |name: &str| columns.remove(name);
        let (t, pv) = (column("t").ok_or("no column t")?, column("pv").ok_or("no column pv")?);
        let [sp, op, position] = ["sp", "op", "position"].map(&mut column);
        let [flags, marks] = ["flags", "marks"]
            .map(|name| column(name).map(|sums| sums.into_iter().map(|sum| sum as u8).collect::<Vec<u8>>()));
        let columns = Self { t, sp, pv, op, position, flags, marks };
        let same = [Some(&columns.pv), columns.sp.as_ref(), columns.op.as_ref(), columns.position.as_ref()];
        let sums = [&columns.flags, &columns.marks].into_iter().flatten().map(Vec::len);
        if same.into_iter().flatten().map(Vec::len).chain(sums).any(|length| length != columns.t.len()) {
            return Err("the columns are not of the same length".into());
        }
        Ok(columns)
    }

    fn rows(&self, rows: Range<usize>) -> (Inspected<'_>, Option<&[f64]>) {
        let inspected = Inspected {
            t: &self.t[rows.clone()],
            sp: part(&self.sp, &rows),
            pv: &self.pv[rows.clone()],
            op: part(&self.op, &rows),
            flags: self.flags.as_deref().map(|flags| &flags[rows.clone()]),
        };
        (inspected, part(&self.position, &rows))
    }
}

/// A range of a column, where the column is there.
fn part<'a>(column: &'a Option<Vec<f64>>, rows: &Range<usize>) -> Option<&'a [f64]> {
    column.as_deref().map(|column| &column[rows.clone()])
}

impl Recording {
    /// Begins, and gives the unit of OP; `stated` is the one that a person or the file states.
    pub(crate) fn begin(
        mut task: Task,
        stated: Option<&str>,
        columns: HashMap<String, Vec<f64>>,
    ) -> Result<(Self, String), String> {
        let columns = Columns::of(columns)?;
        let (beginning, position) = columns.rows(0..columns.t.len().min(INSPECTED_ROWS));
        let unit = op_unit(stated, task.op_span, beginning.op).to_owned();
        let percent = *task.op_percent.get_or_insert(unit == PERCENT);
        let span = task.op_span.or(percent.then_some((0.0, 100.0))).map(|(low, high)| high - low);
        let analysis = Analysis::new(task, &beginning, position).map_err(|error| error.to_string())?;
        Ok((Self { columns, analysis, span, divided: None }, unit))
    }

    pub(crate) fn rows(&mut self, rows: Range<usize>) -> Result<(), String> {
        if rows.start > rows.end || rows.end > self.columns.t.len() {
            return Err(format!("rows {} to {} of {}", rows.start, rows.end, self.columns.t.len()));
        }
        let marks = self.columns.marks.as_deref().map(|marks| &marks[rows.clone()]);
        let (rows, position) = self.columns.rows(rows);
        self.analysis.take_marked(&rows, position, marks);
        Ok(())
    }

    pub(crate) fn windows(&mut self) -> Result<Value, String> {
        self.divided = self.analysis.problem().and_then(|problem| Divided::of(&problem).ok());
        let windows = self.divided.iter().flat_map(|divided| &divided.windows);
        windows.map(bytes).collect()
    }

    pub(crate) fn join(&self, alone: &[Option<Vec<u8>>], reader: &Reader) -> Result<Value, String> {
        let each = |alone: &Option<Vec<u8>>| alone.as_ref().map_or(Ok(WindowFit::default()), |alone| read(alone));
        let alone: Vec<WindowFit> = alone.iter().map(each).collect::<Result<_, _>>()?;
        let divided = self.divided.as_ref().filter(|divided| divided.windows.len() == alone.len());
        let pv = divided.ok_or_else(|| format!("{} windows were not asked for", alone.len()))?.combine(alone);
        to_json(self.analysis.clone().finish_with(pv), self.span, reader)
    }

    pub(crate) fn finish(self, reader: &Reader) -> Result<Value, String> {
        to_json(self.analysis.finish(&|_| ()), self.span, reader)
    }
}

/// An answer with what its pictures show, and in words.
fn to_json(done: Done, span: Option<f64>, reader: &Reader) -> Result<Value, String> {
    let Done { answer, fitted, .. } = &done;
    let texts = AnswerFacts::of(answer, fitted.as_ref(), span, reader).and_then(|facts| {
        Ok(json!({
            "parts": words::texts_of(&facts, reader)?,
            "fit": facts.fit.map(|fit| fit.reason),
            "quality": answer.quality.iter().map(|one| finding(one, reader)).collect::<Result<Vec<_>, _>>()?,
        }))
    });
    let mut shown = shown(done);
    shown["texts"] = texts.map_err(|error| error.to_string())?;
    Ok(shown)
}

fn finding(one: &Finding, reader: &Reader) -> Result<String, TextError> {
    let message = words::of_finding(one);
    words::text(&message.code, &message.numbers, reader)
}

/// The step test in a recording.
pub(crate) fn step_test(
    manual: Manual,
    settings: &StepTestSettings,
    columns: HashMap<String, Vec<f64>>,
) -> Result<Value, String> {
    let columns = Columns::of(columns)?;
    let (all, position) = columns.rows(0..columns.t.len());
    let mut rows = ManualRows::new(manual);
    rows.take(&all, position);
    Ok(json!(rows.read(settings)))
}

/// Fit of a window alone.
pub(crate) fn alone(window: &[u8]) -> Result<Value, String> {
    bytes(&read::<Window>(window)?.fit())
}

/// A value as bytes, to go from one worker to another: JSON would not keep the bits of what is no number.
fn bytes(of: &impl Serialize) -> Result<Value, String> {
    postcard::to_allocvec(of).map(|bytes| json!(bytes)).map_err(|error| error.to_string())
}

fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Result<T, String> {
    postcard::from_bytes(bytes).map_err(|error| error.to_string())
}

/// An answer with what its pictures show.
fn shown(done: Done) -> Value {
    let Done { answer, crossings, fitted, op } = done;
    let (pv, position) = fitted.map_or((None, None), |fitted| (fitted.pv, fitted.position));
    let shown = position.and_then(Result::ok).map(of_position);
    json!({
        "answer": answer,
        "op": op,
        "half_periods": crossings.map(|(_, crossings)| half_periods(&crossings)),
        "pv": pv.and_then(Result::ok).map(of_pv),
        "position": shown,
    })
}

/// The table of half-periods, a list a column.
fn half_periods(crossings: &Crossings) -> Value {
    let rows = crossings.rows();
    let column = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).collect::<Vec<_>>();
    json!({
        "t_start": column(&|row| row.span.start),
        "t_end": column(&|row| row.span.end),
        "d": column(&|row| row.record.parts.d),
        "reason": rows.iter().map(|row| row.record.reason() as u8).collect::<Vec<_>>(),
    })
}

/// Result of PV, with the record that shows it best.
fn of_pv(joint: JointAnswer) -> Value {
    let JointAnswer { whole, mut records, shown } = joint;
    let SegmentAnswer { starts, h, answer, .. } = records.swap_remove(shown);
    let SegmentFit { predictions, candidates, .. } = &answer;
    let of = |value: fn(&glapp_fit::Prediction) -> f64| predictions.iter().map(value).collect::<Vec<_>>();
    let t: Vec<f64> = predictions.iter().map(|cell| starts[cell.part] + h * cell.step as f64).collect();
    let candidates: Vec<Value> = candidates
        .iter()
        .map(|family| {
            let (d, rise): (Vec<f64>, Vec<f64>) = family.profile.iter().copied().unzip();
            json!({ "lags": family.structure.lags, "integrating": family.structure.integrating, "noise": family.structure.noise.name(),
                "delta_deviance": family.delta_deviance, "d": d, "rise": rise })
        })
        .collect();
    let mut document = Map::new();
    for (name, value) in [
        ("h", h),
        ("kp", answer.kp),
        ("jump", answer.jump),
        ("rise", answer.rise),
        ("range", answer.range),
        ("settles", answer.settles),
        ("lag", answer.lag),
        ("echo", answer.autocorrelation),
        ("lr_no_jump", answer.lr_no_jump),
        ("lr_no_answer", answer.lr_no_answer),
        ("dispersion", whole.dispersion),
    ] {
        document.insert(name.into(), json!(value));
    }
    document.insert("integrating".into(), json!(answer.integrating));
    document.insert("load_steps".into(), json!(answer.load_steps));
    document.insert("traversals".into(), json!(whole.traversals));
    document.insert("reason".into(), json!(whole.reason));
    document.insert("candidates".into(), json!(candidates));
    document.insert("t".into(), json!(t));
    document.insert("pv".into(), json!(of(|cell| cell.pv)));
    document.insert("predicted".into(), json!(of(|cell| cell.predicted)));
    document.insert("valve".into(), json!(of(|cell| cell.position)));
    Value::Object(document)
}

/// Result of the valve's own position, with the record that shows it best.
fn of_position(joint: PositionAnswer) -> Value {
    let PositionAnswer { mut records, shown, .. } = joint;
    let SegmentAnswer { starts, h, answer, .. } = records.swap_remove(shown);
    let of = |value: fn(&glapp_fit::Shown) -> f64| answer.shown.iter().map(value).collect::<Vec<_>>();
    let t: Vec<f64> = answer.shown.iter().map(|row| starts[row.part] + h * row.row as f64).collect();
    json!({ "t": t, "recorded": of(|row| row.recorded), "predicted": of(|row| row.predicted), "valve": of(|row| row.valve) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_test_has_the_document_of_the_crate() {
        let held: Vec<(f64, f64)> = vec![(50.0, 40.0), (54.0, 42.4), (58.0, 45.6), (53.0, 43.2)];
        let noise = |k: usize| ((k * k * 7919) % 1009) as f64 / 1e4;
        let pv: Vec<f64> = (0..160).map(|k| held[k / 40].1 + noise(k)).collect();
        let column = |name: &str, of: Vec<f64>| (name.to_string(), of);
        let op = held.iter().flat_map(|(op, _)| vec![*op; 40]).collect();
        let columns = [column("t", (0..160).map(f64::from).collect()), column("pv", pv), column("op", op)];
        let document = step_test(Manual::All, &StepTestSettings::default(), columns.into_iter().collect()).unwrap();
        assert!((document["d"].as_f64().unwrap() - 2.0).abs() < 0.1 && document["reason"].is_null(), "{document}");
        assert_eq!(
            (&document["readings"][2]["kind"], &document["readings"][0]["evidence"]["code"]),
            (&json!("gap"), &json!("first_move"))
        );
        let uneven = [column("t", vec![0.0]), column("pv", vec![])];
        assert!(step_test(Manual::All, &StepTestSettings::default(), uneven.into_iter().collect()).is_err());
    }

    /// The page said by a rule of its own what the unit of OP is.
    #[test]
    fn the_unit_of_op_is_that_of_the_crate() {
        let begin = |op: [f64; 3], stated, task| {
            let column = |name: &str, of: [f64; 3]| (name.to_string(), of.to_vec());
            let columns = [column("t", [0.0, 1.0, 2.0]), column("pv", [3.0, 4.0, 3.0]), column("op", op)];
            let (recording, unit) = Recording::begin(task, stated, columns.into_iter().collect()).unwrap();
            (unit, recording.span)
        };
        let mut task = Task { op_span: Some((4.0, 20.0)), ..Task::default() };
        assert_eq!(begin([30.0, 60.0, 40.0], None, Task::default()), ("%".into(), Some(100.0)));
        assert_eq!(begin([6.0, 14.0, 8.0], None, Task::default()), ("OP unit".into(), None));
        assert_eq!(begin([6.0, 14.0, 8.0], Some("%"), Task::default()), ("%".into(), Some(100.0)));
        assert_eq!(begin([6.0, 14.0, 8.0], Some("mA"), task.clone()), ("mA".into(), Some(16.0)));
        assert_eq!(begin([0.2, 0.9, 0.4], Some("%"), Task::default()), ("OP unit".into(), None));
        task.op_span = Some((0.0, 100.0));
        assert_eq!(begin([6.0, 14.0, 8.0], None, task), ("%".into(), Some(100.0)));
    }
}
