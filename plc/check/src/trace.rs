//! What a test did with a block, and what it read there: played again on a changed library, the first other bit ends it.

use crate::library::{Build, Compiled, Kind, Library};
use crate::run::{Instance, Probe};
use std::collections::HashMap;
use std::io::{self, Read, Write};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
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
    pins: Vec<String>,
    events: Vec<Event>,
    numbers: HashMap<String, u16>,
    /// What stands at a pin already, and what was read since something happened: neither is noted again.
    stands: HashMap<u16, u64>,
    known: Vec<u16>,
}

impl Trace {
    /// Of a block as it stands after its first download.
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

    /// How long it is.
    pub fn events(&self) -> usize {
        self.events.len()
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

    /// Whether the library still does all of it, to the bit.
    pub fn holds(&self, library: &Library) -> bool {
        self.plays(library, None)
    }

    fn plays(&self, library: &Library, mut probe: Option<&mut Probe<'_>>) -> bool {
        let Ok(mut one) = Instance::new(library, &self.unit) else { return false };
        let Ok(places) = self.pins.iter().map(|pin| one.find(pin)).collect::<Result<Vec<_>, _>>() else { return false };
        self.events.iter().all(|event| match *event {
            Event::Set(pin, value) => {
                let (at, ty, _) = places[usize::from(pin)];
                one.put("", at, ty, value).is_ok()
            }
            Event::Read(pin, value) => {
                let shown = one.shown(places[usize::from(pin)].0);
                shown.to_bits() == value.to_bits() || (shown.is_nan() && value.is_nan())
            }
            Event::Scan => one.tried(probe.as_deref_mut()).is_ok(),
            Event::PowerCut => {
                one.power_cut();
                true
            }
        })
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

    /// What [`write`](Self::write) wrote.
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

/// How much of the traces one mutant is played alone on, in events, before it is given up.
const PATIENCE: usize = 500_000;

/// Mutants of a library, tried on traces all at once: a mutant is played alone only on a trace in which its unit, given what the library's
/// own is given there, leaves another memory behind; on half a million events at most.
#[derive(Debug)]
pub struct Trial {
    library: Library,
    units: Vec<Compiled>,
    /// Number of the mutant and its unit.
    places: Vec<(usize, usize)>,
    /// Those that begin with another memory: they are played whole.
    others: Vec<(usize, usize, Library)>,
    count: usize,
}

impl Trial {
    /// Of a library as it stands.
    pub fn new(library: Library) -> Self {
        Self { library, units: vec![], places: vec![], others: vec![], count: 0 }
    }

    /// Adds a library of which the named unit is changed.
    ///
    /// # Panics
    /// Where there is no such unit.
    pub fn add(&mut self, unit: &str, mut changed: Library) {
        let number = self.library.unit(unit).expect("a unit of the library");
        let begins =
            |library: &Library, one: usize| library.units[one].image.iter().map(|x| x.bits()).collect::<Vec<_>>();
        if begins(&self.library, number) == begins(&changed, number) {
            self.places.push((self.count, number));
            self.units.push(changed.units.swap_remove(number));
        } else {
            self.others.push((self.count, number, changed));
        }
        self.count += 1;
    }

    /// Which of them the traces notice, by the order in which they were added.
    ///
    /// # Panics
    /// Where a trace does not hold on the library as it stands.
    pub fn noticed(mut self, traces: &[&Trace]) -> Vec<bool> {
        let mut noticed = vec![false; self.count];
        let mut whole = self.library.clone();
        let mut probe = Probe::new(&self.library, &self.units);
        let mut played = vec![0; self.count];
        for (place, (_, unit)) in self.places.iter().enumerate() {
            probe.live[*unit].push(place);
        }
        for trace in traces {
            assert!(trace.plays(&self.library, Some(&mut probe)), "a trace of {} does not hold", trace.unit);
            for place in std::mem::take(&mut probe.differ) {
                let (number, unit) = self.places[place];
                let own = std::mem::replace(&mut whole.units[unit], self.units[place].clone());
                noticed[number] = !trace.holds(&whole);
                whole.units[unit] = own;
                played[number] += trace.events();
                if !noticed[number] && played[number] < PATIENCE {
                    probe.live[unit].push(place);
                }
            }
            self.others.retain(|(number, changed, library)| {
                let unit = library.unit(&trace.unit).expect("a unit of the library");
                let inside = library.units[unit].image != self.library.units[unit].image;
                let function = matches!(library.units[*changed].kind, Kind::Function { .. });
                if inside || function {
                    noticed[*number] = !trace.holds(library);
                    played[*number] += trace.events();
                }
                !noticed[*number] && played[*number] < PATIENCE
            });
        }
        noticed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn library(sign: &str) -> Library {
        let text = format!(
            "FUNCTION_BLOCK GlappTry\nVAR_INPUT\n    A : LREAL;\nEND_VAR\nVAR_OUTPUT\n    Y : LREAL;\nEND_VAR\n\
             VAR RETAIN\n    Sum : LREAL;\nEND_VAR\n    Sum := Sum {sign} A;\n    Y := Sum;\nEND_FUNCTION_BLOCK\n"
        );
        Library::of_unruled([("Try.st", text.as_str())].into_iter(), Build::Lreal).unwrap()
    }

    #[test]
    fn a_trace_holds_on_the_source_and_not_on_a_mutant() {
        let library_now = library("+");
        let mut one = Instance::new(&library_now, "GlappTry").unwrap();
        let mut trace = Trace::new("GlappTry", Build::Lreal);
        for a in [0.0, 0.0, 2.0, f64::NAN] {
            if a == 2.0 {
                one.power_cut();
                trace.power_cut();
            }
            if a.is_nan() {
                one.spoil("Sum", 8.0).unwrap();
                trace.spoil("Sum", 8.0);
            } else {
                one.set("A", a).unwrap();
                trace.set("A", a);
            }
            one.call().unwrap();
            trace.scan();
            trace.read("Y", one.get("Y").unwrap());
        }
        let mut file = vec![];
        trace.write(&mut file).unwrap();
        let again = Trace::of(&mut &file[..]).unwrap();
        assert_eq!((again.unit(), again.build(), &again.events), ("GlappTry", Build::Lreal, &trace.events));
        assert!(again.holds(&library_now) && !again.holds(&library("-")));
        let mut trial = Trial::new(library_now.clone());
        for sign in ["-", "+"] {
            trial.add("GlappTry", library(sign));
        }
        assert_eq!(trial.noticed(&[&again]), [true, false]);
        assert!(Trace::of(&mut &file[..file.len() - 1]).is_err());
        assert!(Trace::of(&mut &b"nothing"[..]).is_err());
    }
}
