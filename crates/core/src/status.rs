//! Status flags of a signal, a half-period or a module, one list for all of them.

/// A sum of flags; 0 = all well. No sum of them reaches 2¹⁵, so that a PLC's signed `INT` holds it.
pub type Status = u16;

/// The controller was not in automatic; a value handed over is not followed.
pub const NOT_AUTO: Status = 1;
/// A value was bad or not a number.
pub const BAD: Status = 2;
/// Something in the loop was at its lower limit.
pub const AT_LOW: Status = 4;
/// Something in the loop was at its upper limit.
pub const AT_HIGH: Status = 8;
/// The samples before are missing: the start of a recording, or a gap in it.
pub const DATA_GAP: Status = 16;
/// The setpoint handed over is bad; the last good one is in effect.
pub const BAD_SP: Status = 32;
/// The feed-forward handed over is bad; the last good one is in effect.
pub const BAD_FF: Status = 64;
/// The backward limits cross, or cross the module's own, which then are in effect.
pub const BAD_LIMITS: Status = 128;
/// The gain K has the wrong sign: for the process, or in the detector's settings.
pub const WRONG_SIGN: Status = 256;

/// All flags with the names that they have in every face of glapp, in order.
pub const FLAGS: [(Status, &str); 9] = [
    (NOT_AUTO, "not_auto"),
    (BAD, "bad"),
    (AT_LOW, "at_low"),
    (AT_HIGH, "at_high"),
    (DATA_GAP, "data_gap"),
    (BAD_SP, "bad_sp"),
    (BAD_FF, "bad_ff"),
    (BAD_LIMITS, "bad_limits"),
    (WRONG_SIGN, "wrong_sign"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_flag_is_a_bit_of_its_own_and_all_fit_a_signed_integer() {
        for (bit, (flag, _)) in FLAGS.into_iter().enumerate() {
            assert_eq!(flag, 1 << bit);
        }
        assert!(FLAGS.len() <= 15);
    }
}
