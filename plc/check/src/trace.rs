//! Trace of a test: its writes to a block and its reads, played again on a changed library, the first other bit ends
//! it.

use crate::library::Build;
use std::collections::HashMap;
use std::io::{self, Read, Write};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Event {
    Set(u16, f64),
    Read(u16, f64),
    Scan,
    PowerCut,
}

/// Pins set, scans, power cuts and what was read, in their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    unit: String,
    build: Build,
    pub(crate) pins: Vec<String>,
    pub(crate) events: Vec<Event>,
    numbers: HashMap<String, u16>,
    /// Values known at pins, and reads since the last event: neither is noted again.
    stands: HashMap<u16, u64>,
    known: Vec<u16>,
}

impl Trace {
    /// Trace of a block in its state after the first download.
    pub fn new(unit: &str, build: Build) -> Self {
        Self {
            unit: unit.to_owned(),
            build,
            pins: vec![],
            events: vec![],
            numbers: HashMap::new(),
            stands: HashMap::new(),
            known: vec![],
        }
    }

    /// The block.
    pub fn unit(&self) -> &str {
        &self.unit
    }

    /// The build in which it ran.
    pub fn build(&self) -> Build {
        self.build
    }

    /// Anything was read.
    pub fn shows(&self) -> bool {
        self.events.iter().any(|event| matches!(event, Event::Read(..)))
    }

    fn number(&mut self, pin: &str) -> u16 {
        if let Some(number) = self.numbers.get(pin) {
            return *number;
        }
        let number = self.pins.len() as u16;
        self.pins.push(pin.to_owned());
        self.numbers.insert(pin.to_owned(), number);
        number
    }

    /// Any variable was set.
    pub fn spoil(&mut self, name: &str, value: f64) {
        let number = self.number(name);
        self.events.push(Event::Set(number, value));
        self.known.clear();
    }

    /// A pin was set.
    pub fn set(&mut self, pin: &str, value: f64) {
        let number = self.number(pin);
        if self.stands.insert(number, value.to_bits()) != Some(value.to_bits()) {
            self.events.push(Event::Set(number, value));
            self.known.clear();
        }
    }

    /// A pin was read.
    pub fn read(&mut self, pin: &str, value: f64) {
        let number = self.number(pin);
        if !self.known.contains(&number) {
            self.known.push(number);
            self.events.push(Event::Read(number, value));
        }
    }

    /// A scan ran.
    pub fn scan(&mut self) {
        self.events.push(Event::Scan);
        self.known.clear();
    }

    /// The power went and came back.
    pub fn power_cut(&mut self) {
        self.events.push(Event::PowerCut);
        self.known.clear();
        self.stands.clear();
    }

    /// Puts it into a file.
    ///
    /// # Errors
    /// Where that cannot be written.
    pub fn write(&self, to: &mut impl Write) -> io::Result<()> {
        let build = if self.build == Build::Real { "REAL" } else { "LREAL" };
        writeln!(to, "{} {build} {}", self.unit, self.pins.join(" "))?;
        for event in &self.events {
            let (kind, pin, value) = match *event {
                Event::Set(pin, value) => (0, pin, value),
                Event::Read(pin, value) => (1, pin, value),
                Event::Scan => (2, 0, 0.0),
                Event::PowerCut => (3, 0, 0.0),
            };
            to.write_all(&[kind])?;
            if kind < 2 {
                to.write_all(&pin.to_le_bytes())?;
                to.write_all(&value.to_le_bytes())?;
            }
        }
        Ok(())
    }

    /// Trace from the output of [`write`](Self::write).
    ///
    /// # Errors
    /// Where it cannot be read, or is something else.
    pub fn of(from: &mut impl Read) -> io::Result<Self> {
        let mut bytes = vec![];
        from.read_to_end(&mut bytes)?;
        let other = || io::Error::new(io::ErrorKind::InvalidData, "not a trace");
        let end = bytes.iter().position(|byte| *byte == b'\n').ok_or_else(other)?;
        let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let mut words = head.split_whitespace();
        let unit = words.next().ok_or_else(other)?;
        let build = match words.next() {
            Some("LREAL") => Build::Lreal,
            Some("REAL") => Build::Real,
            _ => return Err(other()),
        };
        let mut trace = Self::new(unit, build);
        trace.pins = words.map(str::to_owned).collect();
        let mut rest = &bytes[end + 1..];
        while let Some((kind, after)) = rest.split_first() {
            rest = after;
            trace.events.push(match kind {
                0 | 1 => {
                    let (pin, value) = (rest.get(..2).ok_or_else(other)?, rest.get(2..10).ok_or_else(other)?);
                    rest = &rest[10..];
                    let pin = u16::from_le_bytes(pin.try_into().map_err(|_| other())?);
                    let value = f64::from_le_bytes(value.try_into().map_err(|_| other())?);
                    if *kind == 0 { Event::Set(pin, value) } else { Event::Read(pin, value) }
                }
                2 => Event::Scan,
                3 => Event::PowerCut,
                _ => return Err(other()),
            });
        }
        Ok(trace)
    }
}
