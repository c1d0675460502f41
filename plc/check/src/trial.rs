//! Mutants of a library, tried on traces all at once.

use crate::library::Library;
use crate::run::{Change, Instance, Probe};
use crate::trace::{Event, Trace};

/// Fate of a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fate {
    /// A trace shows another bit, or stops.
    Noticed,
    /// The program is the same once names are resolved.
    Same,
    /// No statement reads the changed values.
    Unread,
    /// No trace reaches the changed step.
    Unreached,
    /// The changed step always did the same.
    Alike,
    /// The mutant acted differently, and its unit left the same memory.
    Absorbed,
    /// Another memory was left behind, and nothing showed it.
    Hidden,
}

/// Mutants of a library. A mutant runs beside the library only from where it leaves another memory behind until it stands as the library
/// does again.
#[derive(Debug)]
pub struct Trial {
    library: Library,
    changes: Vec<Change>,
}

/// A mutant that stands otherwise.
struct Fork<'l> {
    number: usize,
    one: Instance<'l>,
}

impl Trial {
    /// Trial on an unchanged library.
    pub fn new(library: Library) -> Self {
        Self { library, changes: vec![] }
    }

    /// Adds a library of which the named unit is changed.
    ///
    /// # Panics
    /// Where there is no such unit.
    pub fn add(&mut self, unit: &str, changed: &Library) {
        let number = self.library.unit(unit).expect("a unit of the library");
        self.changes.push(Change::between(&self.library, changed, number));
    }

    /// Fates of the mutants on the traces, in the order in which they were added.
    ///
    /// # Panics
    /// Where a trace does not hold on the library as it stands.
    pub fn fates(&self, traces: impl Iterator<Item = Trace>) -> Vec<Fate> {
        let mut probe = Probe::new(&self.library, &self.changes);
        let mut fates: Vec<Option<Fate>> =
            self.changes.iter().map(|change| change.is_none().then_some(Fate::Same)).collect();
        let mut hidden = vec![false; self.changes.len()];
        for (number, _) in fates.iter().enumerate().filter(|(_, fate)| fate.is_none()) {
            probe.add(&self.library, number);
        }
        for trace in traces {
            self.plays(&trace, &mut probe, &mut fates, &mut hidden);
        }
        let left = |number: usize, fate: Option<Fate>| match fate {
            Some(proved @ (Fate::Noticed | Fate::Same)) => proved,
            _ if self.changes[number].is_unread(&self.library) => Fate::Unread,
            _ if hidden[number] => Fate::Hidden,
            _ if probe.other[number] => Fate::Absorbed,
            _ if probe.reached[number] => Fate::Alike,
            _ => Fate::Unreached,
        };
        fates.iter().enumerate().map(|(number, fate)| left(number, *fate)).collect()
    }

    fn plays(&self, trace: &Trace, probe: &mut Probe<'_>, fates: &mut [Option<Fate>], hidden: &mut [bool]) {
        let wrong = |what: &str| -> ! { panic!("a trace of {} does not hold: {what}", trace.unit()) };
        let Ok(mut one) = Instance::new(&self.library, trace.unit()) else { wrong("no such block") };
        let unit = self.library.unit(trace.unit()).expect("found above");
        let places: Vec<_> = trace.pins.iter().map(|pin| one.find(pin).unwrap_or_else(|_| wrong(pin))).collect();
        let mut begin: Vec<usize> = (0..self.changes.len()).collect();
        begin.retain(|number| fates[*number].is_none() && self.changes[*number].begins(unit).next().is_some());
        let mut forks: Vec<Fork<'_>> = vec![];
        for &number in &begin {
            let mut other = one.with(one.values().to_vec());
            other.begin(&self.changes[number], true);
            (probe.reached[number], probe.other[number]) = (true, true);
            forks.push(Fork { number, one: other });
        }
        let strict = |number: usize| self.changes[number].strict;
        for event in &trace.events {
            match *event {
                Event::Set(pin, value) => {
                    let (at, ty, _) = places[usize::from(pin)];
                    if one.put("", at, ty, value).is_err() {
                        wrong(&trace.pins[usize::from(pin)]);
                    }
                    forks.iter_mut().for_each(|fork| fork.one.put("", at, ty, value).expect("put above"));
                }
                Event::Read(pin, value) => {
                    let at = places[usize::from(pin)].0;
                    let same = |shown: f64| shown.to_bits() == value.to_bits() || (shown.is_nan() && value.is_nan());
                    if !same(one.shown(at)) {
                        wrong(&trace.pins[usize::from(pin)]);
                    }
                    forks.retain(|fork| {
                        let same = same(fork.one.shown(at));
                        if !same {
                            fates[fork.number] = Some(Fate::Noticed);
                        }
                        same
                    });
                }
                Event::Scan => {
                    let before = one.values().to_vec();
                    if let Err(fault) = one.run(None, Some(&mut *probe)) {
                        wrong(&fault.to_string());
                    }
                    let mut fresh: Vec<Fork<'_>> = vec![];
                    for number in std::mem::take(&mut probe.differ) {
                        hidden[number] = true;
                        fresh.push(Fork { number, one: one.with(before.clone()) });
                    }
                    forks.append(&mut fresh);
                    forks.retain_mut(|fork| {
                        if fork.one.run(Some(&self.changes[fork.number]), None).is_err() {
                            fates[fork.number] = Some(Fate::Noticed);
                            return false;
                        }
                        let again = fork.one.stands_as(&one, strict(fork.number));
                        if again {
                            probe.add(&self.library, fork.number);
                        }
                        !again
                    });
                }
                Event::PowerCut => {
                    let before = one.values().to_vec();
                    one.power_cut();
                    let gone: Vec<usize> = forks.iter().map(|fork| fork.number).collect();
                    let again = |number: &&usize| fates[**number].is_none() && !gone.contains(number);
                    for &number in begin.iter().filter(again) {
                        forks.push(Fork { number, one: one.with(before.clone()) });
                    }
                    for fork in &mut forks {
                        fork.one.power_cut();
                        fork.one.begin(&self.changes[fork.number], false);
                    }
                }
            }
        }
        forks.iter().for_each(|fork| probe.add(&self.library, fork.number));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::Build;

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
        let mut trial = Trial::new(library_now.clone());
        for sign in ["-", "+"] {
            trial.add("GlappTry", &library(sign));
        }
        assert_eq!(trial.fates(std::iter::once(again)), [Fate::Noticed, Fate::Same]);
        assert!(Trace::of(&mut &file[..file.len() - 1]).is_err());
        assert!(Trace::of(&mut &b"nothing"[..]).is_err());
    }

    const INNER: &str = "FUNCTION_BLOCK GlappInner\nVAR_INPUT\n    Clear : BOOL;\n    X : LREAL;\nEND_VAR\nVAR_OUTPUT\n    Z : LREAL;\n\
        END_VAR\n    IF Clear THEN\n        Z := 0.0;\n    ELSE\n        Z := Z + X;\n    END_IF;\nEND_FUNCTION_BLOCK\n";

    fn with(begin: &str, body: &str) -> Library {
        let text = format!(
            "FUNCTION_BLOCK GlappTry\nVAR_INPUT\n    A : LREAL;\n    P : BOOL;\nEND_VAR\nVAR_OUTPUT\n    Y : LREAL;\nEND_VAR\n\
             VAR\n    T : LREAL := {begin};\n    U : LREAL;\n    I : INT;\n    Row : ARRAY[0..1] OF LREAL;\n    Inner : GlappInner;\n\
             END_VAR\n{body}END_FUNCTION_BLOCK\n"
        );
        Library::of_unruled([("Try.st", text.as_str()), ("Inner.st", INNER)].into_iter(), Build::Lreal).unwrap()
    }

    /// Whether it is proved that 1.0 in the place of 0.0, and U in the place of T where it is written, is the same: `#` and `@` are what
    /// is changed.
    fn proved(begin: &str, body: &str) -> bool {
        let filled = |number: &str, name: &str| {
            let fill = |text: &str| text.replace('#', number).replace('@', name);
            with(&fill(begin), &fill(body))
        };
        let library = filled("0.0", "T");
        let mut trial = Trial::new(library);
        trial.add("GlappTry", &filled("1.0", "U"));
        match trial.fates(std::iter::empty())[..] {
            [Fate::Unread] => true,
            [Fate::Unreached] => false,
            ref other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_nothing_reads_is_proved() {
        for (begin, body) in [
            ("0.0", "T := #; T := A; Y := T;\n"),
            ("0.0", "@ := 0.0; T := A; U := A; Y := T + U;\n"),
            ("0.0", "T := #; IF P THEN T := A; ELSE T := -A; END_IF; Y := T;\n"),
            ("0.0", "FOR I := 1 TO 2 DO T := A; Y := Y + T; T := #; END_FOR;\n"),
            ("0.0", "Inner(Clear := TRUE, X := #); Inner(Clear := FALSE, X := A); Y := Inner.Z;\n"),
            ("#", "T := A; Y := T;\n"),
        ] {
            assert!(proved(begin, body), "{body}");
        }
    }

    #[test]
    fn what_something_may_read_is_not_proved() {
        for (begin, body) in [
            // On one way.
            ("0.0", "T := #; IF P THEN T := A; END_IF; Y := T;\n"),
            ("0.0", "T := #; WHILE I < 1 DO T := A; I := I + 1; END_WHILE; Y := T;\n"),
            // Read in the next pass, or the next scan.
            ("0.0", "T := A; FOR I := 1 TO 2 DO Y := Y + T; T := #; END_FOR;\n"),
            ("0.0", "Y := T; T := #;\n"),
            ("0.0", "@ := 0.0; Y := T;\n"),
            ("#", "Y := T; T := A;\n"),
            // Read by the caller.
            ("0.0", "Y := #;\n"),
            // Read by a called block.
            ("0.0", "Inner(Clear := P, X := #); Inner(X := A); Y := Inner.Z;\n"),
            ("0.0", "Inner(Clear := TRUE, X := #); Inner(Clear := FALSE); Y := Inner.Z;\n"),
            // Read by a stop, or at a place that is not known here.
            ("0.0", "T := A / #; T := A; Y := T;\n"),
            ("0.0", "Row[1] := #; Row[I] := A; Y := Row[1];\n"),
        ] {
            assert!(!proved(begin, body), "{body}");
        }
    }

    #[test]
    fn what_a_function_leaves_behind_nobody_reads() {
        let proved = |body: &str| {
            let [library, changed] = ["0.0", "1.0"].map(|number| {
                let body = body.replace('#', number);
                let text = format!(
                    "FUNCTION GlappTwice : LREAL\nVAR_INPUT\n    A : LREAL;\nEND_VAR\nVAR\n    T : LREAL;\nEND_VAR\n{body}END_FUNCTION\n"
                );
                Library::of_unruled([("Twice.st", text.as_str())].into_iter(), Build::Lreal).unwrap()
            });
            let mut trial = Trial::new(library);
            trial.add("GlappTwice", &changed);
            trial.fates(std::iter::empty()) == [Fate::Unread]
        };
        assert!(proved("T := A + A;\nGlappTwice := T;\nT := #;\n"));
        assert!(!proved("T := #;\nIF A > 0.0 THEN\nT := A + A;\nEND_IF;\nGlappTwice := T;\n"));
        assert!(!proved("GlappTwice := #;\n"));
    }

    #[test]
    fn a_memory_counts_as_the_same_only_where_nothing_reads_the_rest() {
        let play = |body: &str, other: &str| {
            let library = with("0.0", body);
            let mut one = Instance::new(&library, "GlappTry").unwrap();
            let mut trace = Trace::new("GlappTry", Build::Lreal);
            for a in [1.0, 2.0, 3.0] {
                one.set("A", a).unwrap();
                trace.set("A", a);
                one.call().unwrap();
                trace.scan();
                trace.read("Y", one.get("Y").unwrap());
            }
            let mut trial = Trial::new(library.clone());
            trial.add("GlappTry", &with("0.0", other));
            trial.fates(std::iter::once(trace))[0]
        };
        // The earlier value of T is overwritten.
        let body = "T := A; Y := T; T := A + 1.0;\n";
        assert_eq!(play(body, "T := A; Y := T; T := A + 2.0;\n"), Fate::Absorbed);
        // A mutant may read what the source writes first.
        assert_eq!(play(body, "U := A; Y := T; T := A + 1.0;\n"), Fate::Noticed);
        assert_eq!(play("Y := T; T := A + 1.0;\n", "Y := T; T := A + 2.0;\n"), Fate::Noticed);
        // Another memory that no pin shows.
        assert_eq!(play("Y := A; U := U + 1.0;\n", "Y := A; U := U + 2.0;\n"), Fate::Hidden);
    }
}
