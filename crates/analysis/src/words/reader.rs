//! The person who reads: units, calendar and numbers of rows.

use serde::Deserialize;

/// Facts that a sentence needs beyond the numbers of its message.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reader {
    /// Name of the loop.
    pub name: String,
    /// Unit of PV.
    pub pv_unit: String,
    /// Unit of OP.
    pub op_unit: String,
    /// Local date and time of t = 0 [µs since 1970]; none where the recording's times are plain seconds.
    pub t0: Option<i64>,
    /// Number of the first row of data as a person sees it; 2 below a header.
    pub first_row: i64,
}

impl Default for Reader {
    fn default() -> Self {
        Self { name: String::new(), pv_unit: "PV units".into(), op_unit: "OP units".into(), t0: None, first_row: 2 }
    }
}

impl Reader {
    /// The unit of OP where `%` alone would leave open of what.
    pub fn of_op(&self) -> &str {
        if self.op_unit == "%" { "%OP" } else { &self.op_unit }
    }
}
