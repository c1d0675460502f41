//! A loop put together from modules.

use crate::module::{Jumps, Live, MOST_INPUTS, Module, Refusal};
use crate::{GraphError, SimError};
use glapp_core::modules::Gains;
use glapp_core::{Backward, Forward};

/// A loop of modules: a small graph, checked when it is made, that runs scan by scan.
///
/// It is written as a list of named modules, and wires between them. A wire runs through modules from output to input;
/// where a module has more inputs than one, the last is named:
///
/// ```
/// use glapp_sim::{Graph, Module};
///
/// let modules = vec![
///     ("sp", Module::new("Input", &[("value", 50.0)])?),
///     ("pid", Module::new("Pid", &[("k", 0.5), ("ti", 4.0), ("low", 0.0), ("high", 100.0)])?),
///     ("gap", Module::new("Backlash", &[("d", 2.0)])?),
///     ("process", Module::new("ProcessSim", &[("gain", 1.0), ("t1", 3.0), ("t2", 1.0)])?),
///     ("noise", Module::new("Noise", &[("amplitude", 0.1)])?),
///     ("filter", Module::new("Filter2P", &[("tf", 0.4)])?),
/// ];
/// let wires = ["sp -> pid.sp", "pid -> gap -> process -> noise -> filter -> pid.pv"];
/// let mut tank = Graph::new(0.1, modules, &wires)?;
/// tank.run(600)?;
/// tank.set("pid.k", 0.6)?; // while it runs
/// assert!((tank.get("filter.out")? - 50.0).abs() < 2.0);
/// # Ok::<(), glapp_sim::GraphError>(())
/// ```
///
/// One scan is a forward pass in the order of the wires, and a backward pass in the opposite order. What a
/// `ProcessSim` or a `Plant` gives in a scan was made by the inputs of the scans before, so every circle must hold one.
pub struct Graph {
    h: f64,
    scans: u64,
    nodes: Vec<Node>,
    /// The forward pass.
    order: Vec<usize>,
    /// The modules whose output is there before the scan begins.
    delays: Vec<usize>,
}

struct Node {
    name: String,
    live: Live,
    out: Forward<f64>,
    /// Node that drives each input.
    sources: [Option<usize>; MOST_INPUTS],
    /// Nodes and inputs that follow its output.
    followers: Vec<(usize, usize)>,
    /// Backward signal at each input.
    backward: [Backward<f64>; MOST_INPUTS],
    leads: Leads,
}

/// The phase leads that a module's output must not make jumps for.
#[derive(Clone, Debug, Default)]
struct Leads {
    /// One in its loop.
    in_loop: Option<String>,
    /// One that takes its output.
    after: Option<String>,
}

impl Leads {
    /// Whether a module of this name, as it is to be, may stand here.
    fn allow(&self, name: &str, module: &Module) -> Result<(), GraphError> {
        let (lead, what) = match module.jumps() {
            Some(Jumps::FeedForward) => (&self.in_loop, "u_FF"),
            Some(Jumps::Relay) => (&self.after, "the autotuner's relay"),
            None => return Ok(()),
        };
        let refused = |lead: &String| GraphError::LeadWithJumps { lead: lead.clone(), jumping: name.into(), what };
        lead.as_ref().map_or(Ok(()), |lead| Err(refused(lead)))
    }
}

/// The wires before the modules are made.
struct Wiring<'a> {
    names: &'a [(&'a str, Module)],
    sources: Vec<[Option<usize>; MOST_INPUTS]>,
}

impl Graph {
    /// A graph with scan time `h` \[s\] of named modules, connected by wires.
    pub fn new(h: f64, modules: Vec<(&str, Module)>, wires: &[&str]) -> Result<Self, GraphError> {
        let of_graph = |error: glapp_core::ParameterError| GraphError::Parameter {
            module: "graph".into(),
            error: SimError::Parameter(error),
        };
        crate::error::require("h", h, h > 0.0, "greater than 0 s").map_err(of_graph)?;
        for (i, (name, module)) in modules.iter().enumerate() {
            let plain = !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '_');
            if !plain || modules[..i].iter().any(|other| other.0 == *name) {
                let what = "a module's name is made of letters, digits and _, and is given once".into();
                return Err(GraphError::Wire { wire: (*name).into(), what });
            }
            if let Some(own) = module.own_h().filter(|own| *own != h) {
                return Err(GraphError::SampleTimes { module: (*name).into(), own, h });
            }
        }
        let mut wiring = Wiring { names: &modules, sources: vec![[None; MOST_INPUTS]; modules.len()] };
        for wire in wires {
            wiring.lay(wire)?;
        }
        wiring.open_ends()?;
        let order = wiring.order()?;
        wiring.detectors()?;
        let leads: Vec<Leads> = (0..modules.len()).map(|i| wiring.leads(i)).collect();
        for (leads, (name, module)) in leads.iter().zip(&modules) {
            leads.allow(name, module)?;
        }
        let sources = wiring.sources;
        let delays = (0..modules.len()).filter(|i| modules[*i].1.kind.is_delay).collect();
        let mut nodes = Vec::with_capacity(modules.len());
        for (((name, module), sources), leads) in modules.into_iter().zip(&sources).zip(leads) {
            let connected = sources.map(|source| source.is_some());
            let live = Live::new(module, h, connected)
                .map_err(|error| GraphError::Parameter { module: name.into(), error })?;
            nodes.push(Node {
                name: name.into(),
                live,
                out: Forward::new(0.0, 0),
                sources: *sources,
                followers: Vec::new(),
                backward: [Backward::default(); MOST_INPUTS],
                leads,
            });
        }
        for (i, inputs) in sources.iter().enumerate() {
            for (port, source) in inputs.iter().enumerate() {
                if let Some(source) = source {
                    nodes[*source].followers.push((i, port));
                }
            }
        }
        Ok(Self { h, scans: 0, nodes, order, delays })
    }

    /// The scan time \[s\].
    pub fn h(&self) -> f64 {
        self.h
    }

    /// Number of scans.
    pub fn scans(&self) -> u64 {
        self.scans
    }

    /// One scan, `h` seconds after the one before. Beside a real plant that is the time that has really passed; a
    /// simulated process moves on by the scan time that it was made for.
    pub fn scan(&mut self, h: f64) {
        for &i in &self.delays {
            self.nodes[i].out = self.nodes[i].live.work.output();
        }
        for &i in &self.order {
            let sources = self.nodes[i].sources;
            let inputs = sources.map(|source| source.map_or(Forward::new(0.0, 0), |source| self.nodes[source].out));
            self.nodes[i].out = self.nodes[i].live.work.forward(&inputs, h);
        }
        for &i in self.order.iter().rev() {
            let backward = |&(follower, port): &(usize, usize)| self.nodes[follower].backward[port];
            let back = self.nodes[i].followers.iter().map(backward).reduce(Backward::and);
            self.nodes[i].backward = self.nodes[i].live.work.backward(back);
        }
        self.scans += 1;
    }

    /// Runs so many scans.
    pub fn run(&mut self, scans: usize) -> Result<(), GraphError> {
        self.record(scans, &[], &[]).map(|_| ())
    }

    /// Runs so many scans, with inputs that change from scan to scan, each a module and its column. Gives the columns of what is
    /// recorded, each `module.name`.
    pub fn record(
        &mut self,
        scans: usize,
        inputs: &[(&str, &[f64])],
        recorded: &[&str],
    ) -> Result<Vec<Vec<f64>>, GraphError> {
        let mut fed = Vec::with_capacity(inputs.len());
        for (name, column) in inputs {
            if column.len() != scans {
                return Err(GraphError::Column { module: (*name).into(), values: column.len(), scans });
            }
            fed.push((self.input(name)?, *column));
        }
        let places = recorded.iter().map(|path| self.place(path)).collect::<Result<Vec<_>, _>>()?;
        let mut columns = vec![Vec::with_capacity(scans); recorded.len()];
        for k in 0..scans {
            for (i, column) in &fed {
                self.feed(*i, column[k]);
            }
            self.scan(self.h);
            for ((i, name), column) in places.iter().zip(&mut columns) {
                column.push(self.read(*i, name));
            }
        }
        Ok(columns)
    }

    /// Reads a parameter or variable of a module while it runs: `"pid.k"`, `"pid.mode"`, `"pid.out"`. A default is read as what is in
    /// force; a parameter that is not known is not a number.
    pub fn get(&self, path: &str) -> Result<f64, GraphError> {
        Ok(self.known(path)?.unwrap_or(f64::NAN))
    }

    /// The value of a parameter or output; none where a parameter is not known.
    pub fn known(&self, path: &str) -> Result<Option<f64>, GraphError> {
        let (i, name) = self.place(path)?;
        Ok(self.nodes[i].read(&name).flatten())
    }

    /// The detections behind the estimate of a module with a detector, the oldest first [unit of the output].
    pub fn window(&self, module: &str) -> Result<Vec<f64>, GraphError> {
        let i = self.node(module)?;
        self.nodes[i].live.work.window().ok_or_else(|| self.unknown(i, "window"))
    }

    /// Sets a parameter or variable of a module while it runs; `None`: the parameter is what it is where it is not given. What
    /// the module remembers stays. A value out of its bounds is refused, and all stays as it was.
    pub fn set(&mut self, path: &str, value: impl Into<Option<f64>>) -> Result<(), GraphError> {
        let (i, name) = self.place(path)?;
        let Node { live, leads, name: module, .. } = &mut self.nodes[i];
        let done = live.set(&name, value.into(), |changed| leads.allow(module, changed));
        done.map_err(|refusal| self.refused(i, &name, refusal))
    }

    /// Reads the gain schedule of a `PidAdvanced` while it runs.
    pub fn schedule(&self, module: &str) -> Result<&[Gains<f64>], GraphError> {
        let i = self.node(module)?;
        self.nodes[i].live.schedule().ok_or_else(|| self.unknown(i, "schedule"))
    }

    /// Sets the gain schedule of a `PidAdvanced` while it runs, all rows at once; none: the controller's own gains. The
    /// output goes on from where it is. A row out of its bounds is refused, and the schedule stays as it was.
    ///
    /// ```
    /// use glapp_core::modules::Gains;
    /// use glapp_sim::{Graph, Module};
    ///
    /// let modules = vec![
    ///     ("pv", Module::new("Input", &[])?),
    ///     ("pid", Module::new("PidAdvanced", &[("k", 1.0), ("ti", 5.0)])?),
    ///     ("valve", Module::new("Output", &[])?),
    /// ];
    /// let mut loop_ = Graph::new(0.1, modules, &["pv -> pid.pv", "pv -> pid.by", "pid -> valve"])?;
    /// let row = |at, k| Gains { at, k, ti: 5.0, td: 0.0 };
    /// loop_.set_schedule("pid", &[row(20.0, 1.0), row(60.0, 2.5)])?;
    /// let error = loop_.set_schedule("pid", &[row(20.0, 1.0), row(60.0, -2.5)]).unwrap_err();
    /// assert!(error.to_string().starts_with("pid: k of row 2 = -2.5: must be of the sign"));
    /// assert_eq!(loop_.schedule("pid")?[1].k, 2.5);
    /// # Ok::<(), glapp_sim::GraphError>(())
    /// ```
    pub fn set_schedule(&mut self, module: &str, rows: &[Gains<f64>]) -> Result<(), GraphError> {
        let i = self.node(module)?;
        self.nodes[i].live.set_schedule(rows).map_err(|refusal| self.refused(i, "schedule", refusal))
    }

    /// Puts the controller in force that the autotuner in a `PidAdvanced` offers, without a bump; the half-period under way ends as
    /// a gap. Refused before an experiment has come to its end, and under a gain schedule.
    ///
    /// ```
    /// use glapp_sim::{Graph, Module};
    ///
    /// let tuner = [("tune_amplitude", 5.0), ("tune_wait", 10.0), ("tune_longest", 400.0), ("tune_pv_low", 0.0), ("tune_pv_high", 100.0)];
    /// let pid = [&[("k", 1.0), ("ti", 10.0), ("low", 0.0), ("high", 100.0), ("start", 50.0), ("start_pv", 50.0)][..], &tuner].concat();
    /// let modules = vec![
    ///     ("sp", Module::new("Input", &[("value", 50.0)])?),
    ///     ("pid", Module::new("PidAdvanced", &pid)?),
    ///     ("process", Module::new("ProcessSim", &[("gain", 1.0), ("t1", 3.0), ("t2", 1.0), ("dead_time", 1.0), ("start", 50.0)])?),
    /// ];
    /// let mut tank = Graph::new(0.1, modules, &["sp -> pid.sp", "pid -> process -> pid.pv"])?;
    /// tank.set("pid.tune", 1.0)?;
    /// assert!(tank.take_over("pid").is_err()); // not done yet
    /// tank.run(4000)?;
    /// tank.take_over("pid")?;
    /// assert_eq!(tank.get("pid.k")?, tank.get("pid.tune_k")?);
    /// # Ok::<(), glapp_sim::GraphError>(())
    /// ```
    pub fn take_over(&mut self, module: &str) -> Result<(), GraphError> {
        let i = self.node(module)?;
        self.nodes[i].live.take_over().map_err(|refusal| self.refused(i, "autotuner", refusal))
    }

    /// Makes a detector forget all its detections.
    pub fn reset_detection(&mut self, module: &str) -> Result<(), GraphError> {
        let i = self.node(module)?;
        if self.nodes[i].live.work.reset_detection() { Ok(()) } else { Err(self.unknown(i, "detection")) }
    }

    /// All that can be read: `module.name`.
    pub fn names(&self) -> Vec<String> {
        let of_node = |node: &Node| node.names().iter().map(|name| format!("{}.{name}", node.name)).collect::<Vec<_>>();
        self.nodes.iter().flat_map(of_node).collect()
    }

    /// Hands a value to the `Input` with this number.
    pub(crate) fn feed(&mut self, i: usize, value: f64) {
        self.command(i, "value", value);
    }

    /// Sets one of the commands of the module with this number, to a value that it takes.
    pub(crate) fn command(&mut self, i: usize, name: &str, value: f64) {
        let done = self.nodes[i].live.work.command(name, value);
        debug_assert!(done.is_ok(), "{name} = {value}");
    }

    /// The output of the module with this number.
    pub(crate) fn out(&self, i: usize) -> f64 {
        self.nodes[i].out.value
    }

    /// Value of [`Self::get`] for the module with this number; not a number where the name is unknown.
    pub(crate) fn read(&self, i: usize, name: &str) -> f64 {
        self.nodes[i].read(name).flatten().unwrap_or(f64::NAN)
    }

    fn input(&self, module: &str) -> Result<usize, GraphError> {
        let i = self.node(module)?;
        let kind = self.nodes[i].live.module.kind.name;
        if kind == "Input" { Ok(i) } else { Err(GraphError::NoInput { module: module.into(), kind }) }
    }

    /// The number of a module.
    pub(crate) fn node(&self, module: &str) -> Result<usize, GraphError> {
        self.nodes.iter().position(|node| node.name == module).ok_or_else(|| GraphError::NoName {
            module: "graph".into(),
            name: module.into(),
            known: self.nodes.iter().map(|node| node.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    }

    /// Module and variable of a path "module.variable".
    fn place(&self, path: &str) -> Result<(usize, String), GraphError> {
        let (module, name) = path.split_once('.').unwrap_or((path, "out"));
        let i = self.node(module)?;
        self.nodes[i].read(name).map(|_| (i, name.into())).ok_or_else(|| self.unknown(i, name))
    }

    fn refused(&self, i: usize, name: &str, refusal: Refusal) -> GraphError {
        match refusal {
            Refusal::NoName => self.unknown(i, name),
            Refusal::Graph(error) => error,
            Refusal::Value(error) => GraphError::Parameter { module: self.nodes[i].name.clone(), error },
        }
    }

    fn unknown(&self, i: usize, name: &str) -> GraphError {
        let node = &self.nodes[i];
        GraphError::NoName { module: node.name.clone(), name: name.into(), known: node.names().join(", ") }
    }
}

impl Node {
    fn read(&self, name: &str) -> Option<Option<f64>> {
        match name {
            "out" => Some(Some(self.out.value)),
            "out_flags" => Some(Some(self.out.flags.into())),
            _ => self.live.get(name),
        }
    }

    fn names(&self) -> Vec<&'static str> {
        ["out", "out_flags"].into_iter().chain(self.live.names()).collect()
    }
}

impl Wiring<'_> {
    /// Adds the connections of one wire "a b c".
    fn lay(&mut self, wire: &str) -> Result<(), GraphError> {
        let wrong = |what: String| GraphError::Wire { wire: wire.into(), what };
        let stops: Vec<&str> = wire.split("->").map(str::trim).collect();
        if stops.len() < 2 {
            return Err(wrong("write it as 'from -> to', or through several modules".into()));
        }
        for pair in stops.windows(2) {
            // A stop in the middle is named without a port.
            let from = self.node(pair[0].split('.').next().unwrap_or_default()).map_err(wrong)?;
            let (name, port) = pair[1].split_once('.').map_or((pair[1], None), |(name, port)| (name, Some(port)));
            let to = self.node(name).map_err(wrong)?;
            let inputs = self.names[to].1.kind.inputs;
            let at = match (port, inputs) {
                (None, ["in", ..]) => Some(0),
                (None, _) => None,
                (Some(port), _) => inputs.iter().position(|input| *input == port),
            };
            let Some(at) = at else {
                let inputs = inputs.join(", ");
                return Err(wrong(format!("{} has no such input; name one as {name}.NAME: {inputs}", pair[1])));
            };
            if self.names[from].1.kind.name == "Output" {
                return Err(wrong(format!("{} is an Output: nothing comes out of it", pair[0])));
            }
            if let Some(first) = self.sources[to][at] {
                let (first, second) = (self.name(first), self.name(from));
                return Err(GraphError::TwoSources { input: self.end(to, at), first, second });
            }
            self.sources[to][at] = Some(from);
        }
        Ok(())
    }

    fn node(&self, name: &str) -> Result<usize, String> {
        self.names.iter().position(|node| node.0 == name).ok_or_else(|| format!("there is no module '{name}'"))
    }

    fn name(&self, i: usize) -> String {
        self.names[i].0.into()
    }

    /// Name of an input for an error: module and port.
    fn end(&self, i: usize, port: usize) -> String {
        format!("{}.{}", self.names[i].0, self.names[i].1.kind.inputs[port])
    }

    fn followers(&self, i: usize) -> impl Iterator<Item = (usize, usize)> {
        let all = self.sources.iter().enumerate();
        all.flat_map(move |(to, inputs)| (0..MOST_INPUTS).filter(move |p| inputs[*p] == Some(i)).map(move |p| (to, p)))
    }

    /// Refuses inputs and outputs that must not stay open.
    fn open_ends(&self) -> Result<(), GraphError> {
        for (i, (name, module)) in self.names.iter().enumerate() {
            for (port, input) in module.kind.inputs.iter().enumerate() {
                if self.sources[i][port].is_none() && !module.kind.optional.contains(input) {
                    return Err(GraphError::OpenEnd { end: self.end(i, port) });
                }
            }
            if self.followers(i).next().is_none() && !module.kind.may_end {
                return Err(GraphError::OpenEnd { end: format!("{name}, its output,") });
            }
        }
        Ok(())
    }

    /// The forward pass: every module after those that drive it, except that the output of a delay is there from the start.
    fn order(&self) -> Result<Vec<usize>, GraphError> {
        let n = self.names.len();
        let waits_for = |i: usize, done: &[bool]| {
            self.sources[i].iter().flatten().copied().find(|from| !done[*from] && !self.names[*from].1.kind.is_delay)
        };
        let mut done = vec![false; n];
        let mut order = Vec::with_capacity(n);
        while order.len() < n {
            let before = order.len();
            for i in 0..n {
                if !done[i] && waits_for(i, &done).is_none() {
                    done[i] = true;
                    order.push(i);
                }
            }
            if order.len() > before {
                continue;
            }
            // Whoever waits leads, along those it waits for, into the circle, and once around it.
            let mut way: Vec<usize> = Vec::new();
            let mut at = (0..n).find(|i| !done[*i]).unwrap_or(0);
            while !way.contains(&at) {
                way.push(at);
                at = waits_for(at, &done).unwrap_or(at);
            }
            let from = way.iter().position(|i| *i == at).unwrap_or(0);
            let circle = way[from..].iter().chain([&at]).rev().map(|i| self.names[*i].0);
            return Err(GraphError::Circle(circle.collect::<Vec<_>>().join(" -> ")));
        }
        Ok(order)
    }

    /// A detector needs a controller of its own, whose output reaches one valve without another controller in between.
    fn detectors(&self) -> Result<(), GraphError> {
        for (i, (_, module)) in self.names.iter().enumerate() {
            let controller = match module.kind.name {
                "PidAdvanced" => i,
                "BacklashDetection" if self.is_foreign(i)? => continue,
                "BacklashDetection" => {
                    self.watched_by(i).ok_or_else(|| GraphError::NotWatching { detector: self.name(i) })?
                }
                _ => continue,
            };
            let mut ends = Vec::new();
            let mut ahead = vec![controller];
            let mut seen = vec![false; self.names.len()];
            while let Some(at) = ahead.pop() {
                // Delays may close a circle that holds no process.
                if std::mem::replace(&mut seen[at], true) {
                    continue;
                }
                for (to, port) in self.followers(at) {
                    let kind = self.names[to].1.kind;
                    if kind.is_controller && kind.inputs[port] == "sp" {
                        return Err(GraphError::OuterLoop { detector: self.name(i), inner: self.name(to) });
                    }
                    if kind.is_process() || kind.name == "Output" {
                        ends.push(self.name(to));
                    } else if !kind.is_controller && kind.name != "BacklashDetection" {
                        ahead.push(to);
                    }
                }
            }
            if ends.len() > 1 {
                ends.sort();
                return Err(GraphError::SplitRange { detector: self.name(i), ends: ends.join(" and ") });
            }
        }
        Ok(())
    }

    /// Whether a detector stands beside a controller that is no module here.
    fn is_foreign(&self, detector: usize) -> Result<bool, GraphError> {
        let inputs = self.names[detector].1.kind.inputs;
        let is = |name: &str| {
            inputs.iter().zip(self.sources[detector]).any(|(input, from)| from.is_some() && *input == name)
        };
        match ["op", "u_ff"].into_iter().find(|input| is(input)) {
            Some(input) if !is("flags") => Err(GraphError::ModeUnknown { detector: self.name(detector), input }),
            _ => Ok(is("flags")),
        }
    }

    /// The phase leads around a module. In its loop is one that its output reaches, or that reaches it, without a process between
    /// them: that is how a loop looks beside a real plant, with its ends open. And one with which it is in a circle.
    fn leads(&self, i: usize) -> Leads {
        let (ahead, far_ahead) = (self.reached(i, false), self.reached(i, true));
        let mut leads = Leads::default();
        for lead in (0..self.names.len()).filter(|at| self.names[*at].1.kind.name == "PhaseLead") {
            let name = Some(self.name(lead));
            let behind = self.reached(lead, false)[i];
            if ahead[lead] || behind || (far_ahead[lead] && self.reached(lead, true)[i]) {
                leads.in_loop = leads.in_loop.or(name.clone());
            }
            if ahead[lead] {
                leads.after = leads.after.or(name);
            }
        }
        leads
    }

    /// Modules that the output of a module reaches; modules with a delay end the way unless `through_processes`.
    fn reached(&self, from: usize, through_processes: bool) -> Vec<bool> {
        let mut reached = vec![false; self.names.len()];
        let mut ahead = vec![from];
        while let Some(at) = ahead.pop() {
            for (to, _) in self.followers(at) {
                let new = !core::mem::replace(&mut reached[to], true);
                if new && (through_processes || !self.names[to].1.kind.is_delay) {
                    ahead.push(to);
                }
            }
        }
        reached
    }

    /// The controller beside a detector: the one it is connected to, or the one with the same setpoint and process value.
    fn watched_by(&self, detector: usize) -> Option<usize> {
        let [sp, pv, ..] = self.sources[detector];
        let connected = self.followers(detector).find(|(to, port)| {
            let kind = self.names[*to].1.kind;
            kind.is_controller && kind.inputs[*port] == "ff"
        });
        let same = |i: &usize| self.names[*i].1.kind.is_controller && self.sources[*i][..2] == [pv, sp];
        // The setpoint must be that of the controller in any case.
        let found = connected.map(|(to, _)| to).or_else(|| (0..self.names.len()).find(same))?;
        (self.sources[found][1] == sp).then_some(found)
    }
}
