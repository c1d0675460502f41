//! Pushes for a valve that sticks, at a controller's feed-forward.

use super::{BackwardSignals, Context, Inputs, Is, Kind, MOST_INPUTS, Module, Required, Unknown, Work, open, switch};
use crate::SimError;
use glapp_core::status::{AT_HIGH, AT_LOW, BAD, NOT_AUTO, Status};
use glapp_core::{
    Backward, Forward, ParameterError, Push, Saturation, StictionSample, StictionSettings, StictionState,
};

pub(super) static KIND: Kind = Kind {
    inputs: &["sp", "pv"],
    parameters: &[&[
        ("push", Required),
        ("k", Required),
        ("ti", Required),
        ("size", Required),
        ("limit", Unknown),
        ("hold", Unknown),
        ("period", Unknown),
        ("band", Unknown),
        ("far", Is(0.0)),
        ("rate", Unknown),
        ("release", Unknown),
        ("travel", Unknown),
        ("watch", Unknown),
        ("withdraw", Is(1.0)),
        ("op_low", Unknown),
        ("op_high", Unknown),
    ]],
    commands: &["compensate"],
    variables: &[&["u_ff", "standing", "direction"]],
    ..Kind::plain("Stiction", |m, _| {
        let block = block(m)?;
        Ok(Box::new(Stiction { block, state: StictionState::default(), enable: false, e: 0.0, flags: 0, h: 0.0 }))
    })
};

struct Stiction {
    block: glapp_core::Stiction<f64>,
    state: StictionState<f64>,
    enable: bool,
    /// Control error of this scan, whether it is bad, and the time before it \[s\].
    e: f64,
    flags: Status,
    h: f64,
}

fn block(m: &Module) -> Result<glapp_core::Stiction<f64>, SimError> {
    let push = m.one_of(
        "push",
        &Push::ALL.map(|push| (f64::from(push as u8), push)),
        "1 (knocker), 2 (reinforcement) or 3 (two moves)",
    )?;
    let usual = StictionSettings::new(push, m.value("k"), m.value("ti"), m.value("size"));
    let or = |name, usual: f64| m.known(name).unwrap_or(usual);
    let limits = match (m.known("op_low"), m.known("op_high")) {
        (Some(low), Some(high)) => Saturation::new(low, high)?,
        _ => Saturation::none(),
    };
    let hold = or("hold", usual.hold);
    Ok(glapp_core::Stiction::new(StictionSettings {
        limit: or("limit", usual.limit),
        hold,
        period: or("period", usual.period),
        band: or("band", usual.band),
        far: m.value("far"),
        rate: or("rate", usual.rate),
        release: or("release", usual.release),
        travel: or("travel", usual.travel),
        watch: or("watch", usual.watch),
        withdraw: m.yes("withdraw")?,
        limits,
        ..usual
    })?)
}

impl Work for Stiction {
    fn forward(&mut self, &[sp, pv, ..]: &Inputs, h: f64) -> Forward<f64> {
        (self.e, self.flags, self.h) = (sp.value - pv.value, (sp.flags | pv.flags) & BAD, h);
        Forward::from(self.state.u_ff)
    }

    fn backward(&mut self, back: Option<Backward<f64>>) -> BackwardSignals {
        // Without a controller at its output nothing is known of OP.
        let back = back.unwrap_or(Backward { tracking: f64::NAN, ..Backward::default() });
        let flags = self.flags | back.flags & (AT_LOW | AT_HIGH | NOT_AUTO);
        let u = back.tracking - self.state.u_ff;
        let sample = StictionSample { e: self.e, u, h: self.h, enable: self.enable, flags };
        self.block.update(&mut self.state, &sample);
        [open(); MOST_INPUTS]
    }

    fn change(&mut self, to: &Module, _context: Context) -> Result<(), SimError> {
        self.block = block(to)?;
        Ok(())
    }

    fn get(&self, name: &str) -> Option<f64> {
        let settings = self.block.settings();
        match name {
            "u_ff" => Some(self.state.u_ff),
            "standing" => Some(f64::from(self.state.standing as u8)),
            "direction" => Some(self.state.direction.into()),
            "compensate" => Some(u8::from(self.enable).into()),
            "limit" => Some(settings.limit),
            "hold" => Some(settings.hold),
            "period" => Some(settings.period),
            "band" => Some(settings.band),
            "rate" => Some(settings.rate),
            "release" => Some(settings.release),
            "travel" => Some(settings.travel),
            "watch" => Some(settings.watch),
            _ => None,
        }
    }

    fn command(&mut self, _compensate: &str, value: f64) -> Result<(), ParameterError> {
        self.enable = switch("compensate", value, "0 (off) or 1 (on)")?;
        Ok(())
    }
}
