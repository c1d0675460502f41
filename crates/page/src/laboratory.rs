//! A loop of modules that runs.

use glapp_sim::{Graph, Module};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A loop as it is written: modules by name and kind with their parameters, and wires between them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Project {
    /// Scan time \[s\].
    h: f64,
    modules: Vec<(String, String, BTreeMap<String, f64>)>,
    wires: Vec<String>,
}

pub(crate) struct Laboratory {
    graph: Graph,
    paths: Vec<String>,
}

impl Laboratory {
    /// The laboratory, and the names of its variables with whether each can be set.
    pub(crate) fn new(project: &Project) -> Result<(Self, Value), String> {
        let mut modules = Vec::with_capacity(project.modules.len());
        for (name, kind, parameters) in &project.modules {
            let parameters: Vec<(&str, f64)> = parameters.iter().map(|(key, value)| (key.as_str(), *value)).collect();
            modules.push((name.as_str(), Module::new(kind, &parameters).map_err(|error| format!("{name}: {error}"))?));
        }
        let wires: Vec<&str> = project.wires.iter().map(String::as_str).collect();
        let mut graph = Graph::new(project.h, modules, &wires).map_err(|error| error.to_string())?;
        let paths = graph.names();
        // Asked before the first scan, of the value that it has.
        let editable: Vec<bool> =
            paths.iter().map(|path| graph.known(path).is_ok_and(|value| graph.set(path, value).is_ok())).collect();
        let begun = json!({ "paths": paths, "editable": editable });
        Ok((Self { graph, paths }, begun))
    }

    pub(crate) fn run(&mut self, scans: usize, record: &[String]) -> Result<Value, String> {
        let recorded: Vec<&str> = record.iter().map(String::as_str).collect();
        let columns = self.graph.record(scans, &[], &recorded).map_err(|error| error.to_string())?;
        Ok(json!(columns))
    }

    pub(crate) fn values(&self) -> Result<Value, String> {
        let values: Vec<Option<f64>> = self.paths.iter().map(|path| self.graph.known(path).ok().flatten()).collect();
        Ok(json!(values))
    }

    pub(crate) fn set(&mut self, path: &str, value: Option<f64>) -> Result<Value, String> {
        self.graph.set(path, value).map_err(|error| error.to_string())?;
        Ok(Value::Null)
    }
}
