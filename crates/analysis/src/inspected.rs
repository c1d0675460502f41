//! Rows of a recording as they are looked at.

/// Rows of a recording in columns of equal length, as they came; where lengths differ, the shortest counts.
#[derive(Clone, Copy, Debug)]
pub struct Inspected<'a> {
    /// Time \[s\] since any fixed instant.
    pub t: &'a [f64],
    /// Setpoint [PV unit]; none where it is not recorded, and then nothing is told of the controller.
    pub sp: Option<&'a [f64]>,
    /// Process value [PV unit].
    pub pv: &'a [f64],
    /// Controller output [OP unit], where it is recorded.
    pub op: Option<&'a [f64]>,
    /// The first four flags of `glapp_core::status`, where there are any.
    pub flags: Option<&'a [u8]>,
}

impl Inspected<'_> {
    /// The first `rows` rows, or all where there are fewer.
    pub fn first(&self, rows: usize) -> Self {
        let Self { t, sp, pv, op, flags } = self.even();
        let n = rows.min(t.len());
        Self {
            t: &t[..n],
            sp: sp.map(|x| &x[..n]),
            pv: &pv[..n],
            op: op.map(|x| &x[..n]),
            flags: flags.map(|x| &x[..n]),
        }
    }

    /// Columns cut to the length of the shortest.
    pub(crate) fn even(&self) -> Self {
        let optional = [self.sp.map(<[f64]>::len), self.op.map(<[f64]>::len), self.flags.map(<[u8]>::len)];
        let n = optional.into_iter().flatten().fold(self.t.len().min(self.pv.len()), usize::min);
        Self {
            t: &self.t[..n],
            sp: self.sp.map(|sp| &sp[..n]),
            pv: &self.pv[..n],
            op: self.op.map(|op| &op[..n]),
            flags: self.flags.map(|flags| &flags[..n]),
        }
    }
}
