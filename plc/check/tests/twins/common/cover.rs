//! Branches taken by the random sequences, and the cost of a scan.
#![allow(dead_code, missing_docs)]

use super::{Block, Number, Scan, folder};
use glapp_plc_check::{Build, Library, Way};
use std::cell::RefCell;
use std::rc::Rc;

pub fn sequences() -> u64 {
    std::env::var("GLAPP_SEQUENCES").map_or(200, |count| count.parse().expect("a number of sequences"))
}

/// Operations of each scan: their sum, the most, and how many scans.
#[derive(Default, Clone)]
pub struct Cost(Rc<RefCell<(u64, u64, u64)>>);

impl Cost {
    fn count(&self, operations: u64) {
        let (sum, most, scans) = *self.0.borrow();
        *self.0.borrow_mut() = (sum + operations, most.max(operations), scans + 1);
    }

    /// Counts what a block does in a scan.
    pub fn of<T>(&mut self, block: &Block, scan: impl FnOnce() -> T) -> T {
        let before = block.0.borrow().operations();
        let shown = scan();
        self.count(block.0.borrow().operations() - before);
        shown
    }

    /// A scan that counts the cost of every scan to come.
    pub fn counting(&self, mut scan: Scan, block: &Block) -> Scan {
        let (mut cost, block) = (self.clone(), block.clone());
        Box::new(move |x, h| cost.of(&block, || scan(x, h)))
    }

    pub fn tell<R: Number>(&self, name: &str) {
        let bytes = R::library().bytes(name).unwrap();
        let (sum, most, scans) = *self.0.borrow();
        println!(
            "{name} {:?}: {:.0} operations a scan, {most} at most, {bytes} bytes",
            R::BUILD,
            sum as f64 / scans as f64
        );
    }
}

/// Branches of the library that were taken.
pub struct Cover {
    library: &'static Library,
    build: Build,
    taken: Vec<bool>,
}

impl Cover {
    pub fn new<R: Number>() -> Self {
        Self { library: R::library(), build: R::BUILD, taken: vec![false; R::library().ways.len()] }
    }

    pub fn collect(&mut self, block: &Block) {
        for (all, one) in self.taken.iter_mut().zip(block.0.borrow().taken()) {
            *all |= one;
        }
    }

    /// The first way at lines that begin so was taken.
    pub fn takes(&self, pou: &str, lines: &[&str]) {
        let source = std::fs::read_to_string(folder().join(format!("{}.st", &pou["Glapp".len()..]))).unwrap();
        for (way, taken) in
            self.library.ways.iter().zip(&self.taken).filter(|(way, _)| way.pou == pou && way.branch == 0)
        {
            let line = source.lines().nth(way.line - 1).unwrap().trim();
            assert!(*taken || !lines.iter().any(|begin| line.starts_with(begin)), "{pou}:{}: {line}", way.line);
        }
    }

    /// Checks that both branches at lines that begin so were taken.
    pub fn parts(&self, pou: &str, lines: &[&str]) {
        let source = std::fs::read_to_string(folder().join(format!("{}.st", &pou["Glapp".len()..]))).unwrap();
        let mut found = 0;
        for (way, taken) in self.library.ways.iter().zip(&self.taken).filter(|(way, _)| way.pou == pou) {
            let line = source.lines().nth(way.line - 1).unwrap().trim();
            if lines.iter().any(|begin| line.starts_with(begin)) {
                found += 1;
                assert!(*taken, "{pou}:{}, branch {}: {line}", way.line, way.branch);
            }
        }
        assert!(found >= lines.len(), "{pou}: {found}");
    }

    /// Every way through these was taken.
    pub fn holds(&self, pous: &[&str]) {
        self.holds_but(pous, |_, _| false);
    }

    /// Every way through these was taken, but those that `elsewhere` knows, with its line.
    pub fn holds_but(&self, pous: &[&str], elsewhere: impl Fn(&Way, &str) -> bool) {
        // A changed library is told by its outputs alone.
        if std::env::var_os("GLAPP_PLC").is_some() {
            return;
        }
        let real = if self.build == Build::Real { "real/" } else { "" };
        let mut missing = vec![];
        for (way, taken) in self.library.ways.iter().zip(&self.taken) {
            if *taken || !pous.contains(&&*way.pou) {
                continue;
            }
            let name = format!("{}.st", &way.pou["Glapp".len()..]);
            let source = std::fs::read_to_string(folder().join(real).join(&name));
            let source = source.or_else(|_| std::fs::read_to_string(folder().join(&name))).unwrap();
            let line = source.lines().nth(way.line - 1).unwrap().trim();
            if !elsewhere(way, line) {
                missing.push(format!("{}:{}, branch {}: {line}", way.pou, way.line, way.branch));
            }
        }
        assert!(missing.is_empty(), "no sequence takes\n{}", missing.join("\n"));
    }
}
