//! Every variable of a block by its path, for programs that set and read them under another compiler.

use crate::library::{Elementary, Kind, Library, Ty};
use crate::tree::Class;

/// Owner of a part of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Within {
    /// A function block.
    Block,
    /// A structure.
    Structure,
    /// An array: the part is an index.
    Array,
}

/// A variable of an elementary type.
#[derive(Clone, Debug)]
pub struct Variable {
    /// Path: each part with its owner.
    pub parts: Vec<(String, Within)>,
    /// BOOL, INT, DINT, REAL or LREAL.
    pub ty: &'static str,
    /// A power cut leaves it.
    pub retained: bool,
}

impl Variable {
    /// Path with a dot between the parts.
    pub fn path(&self) -> String {
        self.parts.iter().map(|(name, _)| &**name).collect::<Vec<_>>().join(".")
    }
}

impl Library {
    /// Names of all function blocks and programs, in the order of their files.
    pub fn blocks(&self) -> impl Iterator<Item = &str> {
        self.units.iter().filter(|unit| unit.kind == Kind::Block).map(|unit| &*unit.name)
    }

    /// All variables of a block, with those of the blocks inside; none where there is no such block.
    pub fn variables(&self, name: &str) -> Vec<Variable> {
        let mut all = vec![];
        if let Some(unit) = self.unit(name) {
            self.collect(unit, 0, &mut vec![], &self.units[unit].retained, &mut all);
        }
        all
    }

    /// Variables of a block's outputs; none where there is no such block.
    pub fn outputs(&self, name: &str) -> Vec<Variable> {
        let Some(unit) = self.unit(name) else { return vec![] };
        let shown = |name: &str| self.units[unit].slot(name).is_some_and(|slot| slot.class == Class::Output);
        self.variables(name).into_iter().filter(|variable| shown(&variable.parts[0].0)).collect()
    }

    fn collect(
        &self,
        unit: usize,
        base: usize,
        path: &mut Vec<(String, Within)>,
        retained: &[bool],
        all: &mut Vec<Variable>,
    ) {
        let within = if self.units[unit].kind == Kind::Struct { Within::Structure } else { Within::Block };
        for slot in &self.units[unit].slots {
            let at = base + slot.at;
            path.push((slot.name.clone(), within));
            let mut leaf = |path: &[(String, Within)], ty, at: usize| {
                all.push(Variable { parts: path.to_vec(), ty: word(ty), retained: retained[at] });
            };
            match slot.ty {
                Ty::Unit(inner) => self.collect(inner, at, path, retained, all),
                Ty::Array(low, high, element) => {
                    for index in low..=high {
                        path.push((index.to_string(), Within::Array));
                        leaf(path, element, at + (index - low) as usize);
                        path.pop();
                    }
                }
                Ty::Bool => leaf(path, Elementary::Bool, at),
                Ty::Int => leaf(path, Elementary::Int, at),
                Ty::Dint => leaf(path, Elementary::Dint, at),
                Ty::Real => leaf(path, Elementary::Real, at),
                Ty::Lreal => leaf(path, Elementary::Lreal, at),
            }
            path.pop();
        }
    }
}

fn word(ty: Elementary) -> &'static str {
    match ty {
        Elementary::Bool => "BOOL",
        Elementary::Int => "INT",
        Elementary::Dint => "DINT",
        Elementary::Real => "REAL",
        Elementary::Lreal => "LREAL",
    }
}
