//! The rows of one loop, batch by batch.

use crate::{LakeError, LoopFiles};
use glapp_core::Columns;
use glapp_lanes::{Instructions, NullaryFnOnce};
use parquet::basic::{ConvertedType, LogicalType, TimeUnit};
use parquet::column::reader::ColumnReader;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Rows of a batch.
const BATCH: usize = 4096;

/// The rows of a loop: those that are read and not passed yet, and where the others are.
pub(crate) struct Stream {
    source: LoopFiles,
    /// Files that were begun.
    begun: usize,
    open: Option<Open>,
    t: Vec<f64>,
    sp: Vec<f64>,
    pv: Vec<f64>,
    op: Vec<f64>,
    /// Rows of the batch that are passed.
    from: usize,
    /// Rows of all batches that are.
    done: u64,
    clock: Clock,
    scratch: Scratch,
    instructions: Instructions,
}

/// A file, and the columns of its group of rows under way.
struct Open {
    reader: SerializedFileReader<File>,
    groups: usize,
    /// Rows of the file before the batch.
    rows: u64,
    columns: Vec<Column>,
}

/// A column of a group of rows.
struct Column {
    name: String,
    reader: ColumnReader,
    /// The level at which a value is there.
    there: i16,
    /// Unit of its integers, where it holds timestamps.
    ticks: Option<Ticks>,
}

/// Since 1970.
#[derive(Clone, Copy, Debug)]
enum Ticks {
    Millis,
    Micros,
    Nanos,
}

impl Ticks {
    /// Microseconds of one of them; none where it is less than one.
    fn each(self) -> Option<i64> {
        match self {
            Self::Millis => Some(1000),
            Self::Micros => Some(1),
            Self::Nanos => None,
        }
    }

    /// The moment in whole microseconds, as Arrow has it.
    fn micros(self, tick: i64) -> i64 {
        self.each().map_or(tick / 1000, |factor| tick.saturating_mul(factor))
    }
}

/// The loop's time: seconds since a moment.
#[derive(Clone, Copy, Debug)]
struct Clock {
    /// The moment, that of the first row where none is given \[µs since 1970\].
    begin: Option<i64>,
    /// The last one \[s\].
    last: Option<f64>,
}

/// Memory that is used again from batch to batch.
#[derive(Default)]
struct Scratch {
    levels: Vec<i16>,
    long: Vec<i64>,
    short: Vec<i32>,
    single: Vec<f32>,
}

impl Stream {
    pub(crate) fn new(source: LoopFiles, instructions: Instructions) -> Self {
        let clock = Clock { begin: source.since, last: None };
        let (t, sp, pv, op) = Default::default();
        Self {
            source,
            begun: 0,
            open: None,
            t,
            sp,
            pv,
            op,
            from: 0,
            done: 0,
            clock,
            scratch: Scratch::default(),
            instructions,
        }
    }

    /// Whether there is a row; reads on where all were passed. After an error there is none.
    pub(crate) fn ready(&mut self) -> Result<bool, LakeError> {
        let found = self.read_on();
        if found.is_err() {
            (self.open, self.begun) = (None, self.source.files.len());
            self.forget();
        }
        found
    }

    /// Reads the next batch; whether there was one.
    fn read_on(&mut self) -> Result<bool, LakeError> {
        while self.rows() == 0 {
            if self.open.is_none() {
                let Some(path) = self.source.files.get(self.begun) else { return Ok(false) };
                self.open = Some(Open::new(path)?);
                self.begun += 1;
            }
            let path = self.source.files[self.begun - 1].clone();
            // A damaged page is a thing that the library may panic at.
            let read = catch_unwind(AssertUnwindSafe(|| self.read(&path)));
            let damaged = |_| Err(LakeError::of(&path, "is damaged: copy it anew from where it came"));
            if !read.unwrap_or_else(damaged)? {
                self.open = None;
            }
        }
        Ok(true)
    }

    /// Rows that are read and not passed.
    pub(crate) fn rows(&self) -> usize {
        self.t.len() - self.from
    }

    /// Rows that were passed.
    pub(crate) fn done(&self) -> u64 {
        self.done
    }

    /// The next `n` rows, no more than there are.
    pub(crate) fn columns(&self, n: usize) -> Columns<'_, f64> {
        let part = self.from..self.from + n;
        Columns {
            t: &self.t[part.clone()],
            sp: &self.sp[part.clone()],
            pv: &self.pv[part.clone()],
            op: self.source.op.as_ref().map(|_| &self.op[part]),
            flags: None,
        }
    }

    /// Skips values.
    pub(crate) fn pass(&mut self, n: usize) {
        self.from += n;
        self.done += n as u64;
    }

    /// Drops the rows that are used.
    fn forget(&mut self) {
        for column in [&mut self.t, &mut self.sp, &mut self.pv, &mut self.op] {
            column.clear();
        }
        self.from = 0;
    }

    /// Reads the next batch of rows of the open file; false at its end.
    fn read(&mut self, path: &Path) -> Result<bool, LakeError> {
        let Some(open) = &mut self.open else { return Ok(false) };
        open.rows += self.t.len() as u64;
        self.from = 0;
        loop {
            if open.columns.is_empty() {
                self.t.clear();
                if !open.begin(path, &self.source)? {
                    return Ok(false);
                }
            }
            let (columns, scratch) = (&mut open.columns, &mut self.scratch);
            let ticks = columns[0].ticks;
            let fault = |error: ParquetError| LakeError::of(path, format!("cannot be decoded: {error}"));
            match ticks {
                Some(ticks) => {
                    columns[0].integers(scratch).map_err(fault)?;
                    self.clock.seconds(&scratch.long, ticks, &mut self.t, self.instructions);
                }
                None => columns[0].numbers(scratch, &mut self.t).map_err(fault)?,
            }
            let signals = [&mut self.sp, &mut self.pv, &mut self.op];
            for (column, signal) in columns[1..].iter_mut().zip(signals) {
                column.numbers(scratch, signal).map_err(fault)?;
                if signal.len() != self.t.len() {
                    let what = format!("column {} has no more rows where the time has: it is damaged", column.name);
                    return Err(LakeError::of(path, what).at(open.rows + signal.len() as u64 + 1));
                }
            }
            if !self.t.is_empty() {
                return match self.clock.first_not_after(&self.t) {
                    None => Ok(true),
                    Some(k) => {
                        let what = "its time is missing or not after that of the row before: sort the rows by time, each moment once";
                        Err(LakeError::of(path, what).at(open.rows + k as u64 + 1))
                    }
                };
            }
            open.columns.clear();
        }
    }
}

impl Open {
    fn new(path: &Path) -> Result<Self, LakeError> {
        let file = File::open(path).map_err(|error| LakeError::of(path, format!("cannot be opened: {error}")))?;
        let reader = SerializedFileReader::new(file)
            .map_err(|error| LakeError::of(path, format!("is not a readable Parquet file: {error}")))?;
        Ok(Self { reader, groups: 0, rows: 0, columns: Vec::new() })
    }

    /// Begins the next group of rows; false where there is none.
    fn begin(&mut self, path: &Path, source: &LoopFiles) -> Result<bool, LakeError> {
        if self.groups == self.reader.num_row_groups() {
            return Ok(false);
        }
        let fault = |error: ParquetError| LakeError::of(path, format!("cannot be decoded: {error}"));
        let group = self.reader.get_row_group(self.groups).map_err(fault)?;
        self.groups += 1;
        let schema = group.metadata().schema_descr();
        let names = [Some(&source.time), Some(&source.sp), Some(&source.pv), source.op.as_ref()];
        for (i, name) in names.into_iter().flatten().enumerate() {
            let Some(at) = schema.columns().iter().position(|column| column.path().parts() == [name.as_str()]) else {
                return Err(LakeError::of(path, format!("has no column {name}: name the one that is there")));
            };
            let reader = group.get_column_reader(at).map_err(fault)?;
            let column = Column::new(name, &schema.column(at), reader, i == 0);
            self.columns.push(column.map_err(|what| LakeError::of(path, what))?);
        }
        Ok(true)
    }
}

impl Column {
    fn new(name: &str, described: &ColumnDescriptor, reader: ColumnReader, time: bool) -> Result<Self, String> {
        let ticks = match (described.logical_type_ref(), described.converted_type()) {
            (Some(LogicalType::Timestamp(time)), _) => Some(match time.unit {
                TimeUnit::MILLIS => Ticks::Millis,
                TimeUnit::MICROS => Ticks::Micros,
                TimeUnit::NANOS => Ticks::Nanos,
            }),
            (_, ConvertedType::TIMESTAMP_MILLIS) => Some(Ticks::Millis),
            (_, ConvertedType::TIMESTAMP_MICROS) => Some(Ticks::Micros),
            _ => None,
        };
        let number = matches!(
            reader,
            ColumnReader::DoubleColumnReader(_)
                | ColumnReader::FloatColumnReader(_)
                | ColumnReader::Int32ColumnReader(_)
                | ColumnReader::Int64ColumnReader(_)
        );
        let plain = described.max_rep_level() == 0
            && (ticks.is_some()
                || described.logical_type_ref().is_none_or(|kind| matches!(kind, LogicalType::Integer(_))));
        if !number || !plain || (ticks.is_some() && !time) {
            let needed = if time { "timestamps or numbers of seconds" } else { "numbers" };
            return Err(format!("column {name} holds {:?}, where {needed} are needed", described.physical_type()));
        }
        Ok(Self { name: name.into(), reader, there: described.max_def_level(), ticks })
    }

    /// The next numbers, as many as a batch has, fewer at the end of the group; NaN where there is none.
    fn numbers(&mut self, scratch: &mut Scratch, out: &mut Vec<f64>) -> Result<(), ParquetError> {
        let Scratch { levels, long, short, single } = scratch;
        let there = self.there;
        levels.clear();
        out.clear();
        macro_rules! converted {
            ($reader:expr, $values:expr) => {{
                $values.clear();
                let (rows, ..) = $reader.read_records(BATCH, Some(&mut *levels), None, $values)?;
                out.extend($values.iter().map(|x| *x as f64));
                rows
            }};
        }
        let rows = match &mut self.reader {
            ColumnReader::DoubleColumnReader(reader) => reader.read_records(BATCH, Some(&mut *levels), None, out)?.0,
            ColumnReader::FloatColumnReader(reader) => converted!(reader, single),
            ColumnReader::Int32ColumnReader(reader) => converted!(reader, short),
            ColumnReader::Int64ColumnReader(reader) => converted!(reader, long),
            _ => 0,
        };
        spread(out, levels, there, rows, f64::NAN);
        Ok(())
    }

    /// The next timestamps, as many as a batch has; the smallest integer where there is none.
    fn integers(&mut self, scratch: &mut Scratch) -> Result<(), ParquetError> {
        let Scratch { levels, long, .. } = scratch;
        levels.clear();
        long.clear();
        if let ColumnReader::Int64ColumnReader(reader) = &mut self.reader {
            let (rows, ..) = reader.read_records(BATCH, Some(&mut *levels), None, long)?;
            spread(long, levels, self.there, rows, i64::MIN);
        }
        Ok(())
    }
}

/// Puts values where their levels say that they are there.
fn spread<T: Copy>(values: &mut Vec<T>, levels: &[i16], there: i16, rows: usize, none: T) {
    let mut from = values.len();
    values.resize(rows, none);
    for to in (0..rows).rev().take_while(|_| levels.len() == rows) {
        if from > to {
            break; // none is missing before
        }
        values[to] = if levels[to] == there {
            from -= 1;
            values[from]
        } else {
            none
        };
    }
}

/// Seconds of integers that are there and far from the largest, as all are in a file that is in order.
struct Seconds<'a> {
    all: &'a [i64],
    /// Microseconds of one of them.
    factor: i64,
    begin: i64,
    out: &'a mut [f64],
    done: &'a mut bool,
}

impl NullaryFnOnce for Seconds<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        const FAR: i64 = 1 << 50;
        let Self { all, factor, begin, out, done } = self;
        let near = |x: i64| (x > -FAR) & (x < FAR);
        *done = all.iter().fold((begin / 1000).abs() < FAR, |near_all, tick| near_all & near(*tick));
        if *done {
            out.iter_mut().zip(all).for_each(|(out, tick)| *out = (tick * factor - begin) as f64 / 1e6);
        }
    }
}

impl Clock {
    /// Seconds; no number where there is none.
    fn seconds(&mut self, all: &[i64], ticks: Ticks, out: &mut Vec<f64>, instructions: Instructions) {
        self.begin = self.begin.or(all.first().map(|tick| ticks.micros(*tick)));
        let begin = self.begin.unwrap_or_default();
        out.clear();
        out.resize(all.len(), f64::NAN);
        let mut done = false;
        if let Some(factor) = ticks.each() {
            instructions.run(Seconds { all, factor, begin, out: &mut *out, done: &mut done });
        }
        if !done {
            let there = out.iter_mut().zip(all).filter(|(_, tick)| **tick != i64::MIN);
            there.for_each(|(out, tick)| *out = ticks.micros(*tick).saturating_sub(begin) as f64 / 1e6);
        }
    }

    /// The first row whose time is not after that of the row before.
    fn first_not_after(&mut self, t: &[f64]) -> Option<usize> {
        let after = |a: f64, b: f64| b > a;
        let first = self.last.is_none_or(|last| after(last, t[0])) && t[0].is_finite();
        let ordered = first && t.windows(2).fold(true, |all, pair| all & after(pair[0], pair[1]));
        if !ordered {
            return Some(if first {
                1 + t.windows(2).position(|pair| !after(pair[0], pair[1])).unwrap_or(0)
            } else {
                0
            });
        }
        self.last = t.last().copied();
        None
    }
}
