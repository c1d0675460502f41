//! The verdict: rules and weighed evidence together.

use crate::decide::evidence::{Evidence, rules};
use crate::decide::judgement::{Cause, Confidence, Judgement, WidthKind};
use crate::decide::thresholds::*;
use crate::decide::weigh::{USUAL_PRIOR, probability};

impl Evidence {
    /// Judgement on the valve, and a code of the reason why it says no more.
    pub fn judged(&self) -> (Judgement, &'static str) {
        judge(self)
    }

    /// Whether the weighed evidence may make a gap likely that the rules do not find: the ratio exceeds what a gap of so sharp a width needs,
    /// the valve moves in the model, OP goes through the width both ways, and PV is not stored as lines that bend as much. Where a load that
    /// swings would look like the gap, its width is known, and an even swing asks for more.
    fn may_be_likely(&self) -> bool {
        let shows = !self.immobile && !self.one_way && self.d >= self.lined_below;
        let sided = !self.swings() || self.width_kind() != WidthKind::Unsure;
        let asked = if self.even_swing { LR_IF_EVEN_SWING } else { self.least_ratio() };
        self.lr_no_gap > asked && self.low > 0.0 && shows && sided
    }

    /// Whether nothing stands between the record and the width: OP goes through it twice each way, samples and noise show it, no load that
    /// swings looks like it, and its lower limit is near.
    fn is_plain(&self) -> bool {
        let clear = self.width_kind() != WidthKind::Unsure && !self.noisy() && !self.swings();
        self.crossed_twice() && clear && self.low_is_near()
    }

    /// Whether a window shows a gap by itself: it is told there, or nothing looks like it, and its ratio is no small part of what is needed, of
    /// which what the model lacks brings a little in every window.
    pub(crate) fn shows_alone(&self) -> bool {
        let shows = judge(self).0.tells() || self.crossed_twice() && self.veto().is_none() && !self.swings();
        shows && (self.cycles() || self.lr_no_gap > LR_MIN.max(WINDOW_SHOWS * self.asked()))
    }

    /// Cause of a gap, by the slip jump.
    fn cause(&self) -> Cause {
        match (self.slips, self.slips_wholly) {
            (false, _) => Cause::DeadBand,
            (true, true) => Cause::Stiction,
            (true, false) => Cause::Both,
        }
    }

    /// The probability of a gap by which the rungs are decided: where as many valves have one as usual. 0 where the record cannot be read.
    fn usual_probability(&self) -> f64 {
        self.weighed().map_or(0.0, |(factor, _)| probability(factor, USUAL_PRIOR))
    }
}

/// Judgement on the valve, and a code of the reason why it says no more.
///
/// The [`rules`] say which gap may be found, and which valve shows none. All evidence, weighed, must then make a gap less probable than
/// [`IMPROBABLE`] for none, and more than [`PROBABLE`] for one: what the rules find is *found*, what they call likely or leave open is
/// *likely*. Where the record is plain it is enough for *likely* that the evidence speaks for a gap at all.
pub(crate) fn judge(e: &Evidence) -> (Judgement, &'static str) {
    let (by_rules, why) = rules(e);
    let p = e.usual_probability();
    let least = if e.is_plain() { USUAL_PRIOR } else { PROBABLE };
    let gap = |confidence| {
        let (cause, width_kind) = (Some(e.cause()), Some(e.width_kind()));
        Judgement { confidence, cause, width_kind, oscillates: e.oscillates }
    };
    let silent = Judgement::without(Confidence::CannotTell, e.oscillates);
    match by_rules {
        // A gap that is a trifle to OP's range is none, however probable it is.
        Confidence::NoneSeen if p > IMPROBABLE && e.lr_no_gap <= e.needed() => (silent, "may_be_a_gap"),
        Confidence::NoneSeen => (Judgement::without(by_rules, e.oscillates), why),
        Confidence::Found | Confidence::Likely if p >= PROBABLE => (gap(by_rules), why),
        Confidence::Found | Confidence::Likely if p >= USUAL_PRIOR && e.own_swing() => (gap(Confidence::Likely), why),
        Confidence::Found | Confidence::Likely => (silent, "outweighed"),
        Confidence::CannotTell if p >= least && e.may_be_likely() => (gap(Confidence::Likely), why),
        Confidence::CannotTell => (silent, why),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decide::evidence::lr_asked;
    use crate::decide::judgement::Verdict;
    use crate::decide::witness::cycle::Cycle;
    use crate::decide::witness::plateau::Plateau;

    /// A plain gap of 1 in a range of 10.
    fn plain() -> Evidence {
        Evidence {
            autocorrelation: 0.0,
            d: 1.0,
            cells: 3000,
            lr_no_gap: 200.0,
            lr_needed: 15.0,
            lr_no_answer: 1e3,
            low: 0.9,
            high: Some(1.1),
            range: 10.0,
            immobile: false,
            one_way: false,
            coarse: false,
            at_once: false,
            noisy_below: 0.0,
            information_ratio: 1.0,
            slips: false,
            slips_wholly: false,
            periodic_load: false,
            even_swing: false,
            lined_below: 0.0,
            unsampled_below: 0.0,
            dissent: false,
            hidden: None,
            passes: [10; 2],
            passes_high: [10; 2],
            oscillates: false,
            cycle: None,
            plateau: Plateau::default(),
            cancels: 2.0,
            lag_up_to: 1.2,
            agree: [1; 2],
            dispersion: 1.0,
            shows: None,
        }
    }

    fn verdict(e: &Evidence) -> Verdict {
        judge(e).0.verdict(e.low)
    }

    #[test]
    fn a_gap_far_below_what_op_moves_is_none() {
        assert_eq!(verdict(&plain()), Verdict::Backlash);
        let narrow = Evidence { range: 111.0, ..plain() };
        assert_eq!(verdict(&narrow), Verdict::Sound);
        assert_eq!(narrow.limits(&judge(&narrow).0, Some(1.1)), (0.0, Some(1.1)));
        assert_eq!(verdict(&Evidence { high: None, ..narrow }), Verdict::AtLeast);
    }

    #[test]
    fn no_valve_is_sound_below_what_op_may_shake_it_through() {
        let sound = Evidence { d: 0.0, lr_no_gap: 0.0, low: 0.0, unsampled_below: 1.5, ..plain() };
        assert_eq!(verdict(&sound), Verdict::Sound);
        assert_eq!(sound.limits(&judge(&sound).0, Some(1.1)), (0.0, Some(1.5)));
        let unsampled = Evidence { unsampled_below: 2.5, ..sound };
        assert_eq!((verdict(&unsampled), judge(&unsampled).1), (Verdict::CannotTell, "may_be_a_gap"));
    }

    #[test]
    fn no_valve_is_sound_where_a_load_that_swings_moves_pv_against_op() {
        let against = Plateau { ways: [CYCLES; 2], within: OPPOSED - 0.1 };
        let none = Evidence { d: 0.1, lr_no_gap: 0.0, low: 0.0, even_swing: true, ..plain() };
        assert_eq!(verdict(&none), Verdict::Sound);
        let led = Evidence { plateau: against, ..none.clone() };
        assert_eq!((verdict(&led), judge(&led).1), (Verdict::CannotTell, "repeats"));
        // An upper limit that is too wide for a sound valve has the same reason, and no acceptable limit makes that valve likely sound.
        assert_eq!(judge(&Evidence { high: Some(9.0), ..led.clone() }).1, "repeats");
        assert_eq!(verdict(&Evidence { even_swing: false, ..led }), Verdict::Sound);
    }

    #[test]
    fn no_valve_is_sound_where_pv_strays_from_the_model_at_its_turns() {
        let none =
            Evidence { d: 0.1, lr_no_gap: 0.0, low: 0.0, information_ratio: INFORMATION_RATIO_IF_SOUND, ..plain() };
        assert_eq!(verdict(&none), Verdict::Sound);
        let strays = Evidence { information_ratio: INFORMATION_RATIO_IF_SOUND - 0.01, ..none };
        assert_eq!((verdict(&strays), judge(&strays).1), (Verdict::CannotTell, "may_be_a_gap"));
    }

    #[test]
    fn no_valve_is_sound_where_a_gap_is_half_as_probable_as_usual() {
        let none = Evidence { d: 0.1, lr_no_gap: 6.0, low: 0.0, ..plain() };
        assert_eq!(verdict(&none), Verdict::Sound);
        // A gap explains most of what OP explains of PV.
        let doubtful = Evidence { lr_no_gap: 11.0, lr_no_answer: 16.0, cancels: 0.0, ..none };
        assert!(doubtful.usual_probability() > IMPROBABLE, "{}", doubtful.usual_probability());
        assert_eq!((rules(&doubtful).0, verdict(&doubtful)), (Confidence::NoneSeen, Verdict::CannotTell));
    }

    fn said(e: &Evidence) -> (Confidence, Option<WidthKind>) {
        let told = judge(e).0;
        (told.confidence, told.width_kind)
    }

    #[test]
    fn less_than_what_is_found_is_likely() {
        let of = |lr_no_gap| Evidence { lr_no_gap, lr_needed: 60.0, ..plain() };
        assert_eq!(said(&of(61.0)), (Confidence::Found, Some(WidthKind::Interval)));
        assert_eq!(said(&of(59.0)), (Confidence::Likely, Some(WidthKind::Interval)));
        assert_eq!(verdict(&of(59.0)), Verdict::CannotTell);
        assert_eq!(said(&of(LR_MIN)), (Confidence::CannotTell, None));
        // However seldom OP went through it, and whatever PV's noise is, a width that is told has two limits.
        let seldom = Evidence { passes: [1; 2], noisy_below: 9.0, ..of(61.0) };
        assert_eq!(said(&seldom), (Confidence::Found, Some(WidthKind::Interval)));
        assert_eq!(said(&Evidence { high: None, ..of(200.0) }), (Confidence::Found, Some(WidthKind::Bound)));
        // A record that looks like a gap for another reason is not likely either.
        assert_eq!(said(&Evidence { immobile: true, ..of(59.0) }), (Confidence::CannotTell, None));
        assert_eq!(said(&Evidence { low: 0.1, ..of(61.0) }), (Confidence::Likely, Some(WidthKind::Unsure)));
    }

    #[test]
    fn in_a_plain_record_any_evidence_for_a_gap_makes_it_likely() {
        // OP went through it twice each way, and a load of which nothing is known may do that.
        let twice = Evidence { passes: [2; 2], lr_no_gap: 30.0, lr_needed: LR_IF_SELDOM, ..plain() };
        let weak = Evidence { noisy_below: 0.3, range: 4.0, ..twice };
        let p = weak.usual_probability();
        assert!(USUAL_PRIOR < p && p < PROBABLE, "{p}");
        assert_eq!(said(&weak), (Confidence::Likely, Some(WidthKind::Interval)));
        for hidden in [
            Evidence { even_swing: true, ..weak.clone() },
            Evidence { coarse: true, ..weak.clone() },
            Evidence { noisy_below: 1.1, ..weak.clone() },
            Evidence { low: 0.5 * NEAR_LOW, ..weak.clone() },
            Evidence { passes: [2, 1], ..weak.clone() },
        ] {
            assert!(!hidden.is_plain());
            assert_eq!(said(&hidden), (Confidence::CannotTell, None));
        }
    }

    #[test]
    fn a_width_that_is_not_sharp_asks_for_more_the_longer_the_record() {
        let asked = 3000.0 * LR_EACH_CELL;
        let vague = Evidence { low: NEAR_LOW - 0.01, lr_no_gap: asked, ..plain() };
        assert_eq!((said(&vague), judge(&vague).1), ((Confidence::CannotTell, None), "may_be_a_gap"));
        assert_eq!((vague.needed(), vague.asked()), (asked, LR_MIN));
        assert_eq!(said(&Evidence { lr_no_gap: asked + 1.0, ..vague.clone() }).0, Confidence::Found);
        assert_eq!(said(&Evidence { cells: 2900, ..vague.clone() }).0, Confidence::Found);
        assert_eq!(said(&Evidence { low: NEAR_LOW + 0.01, lr_no_gap: 16.0, ..vague.clone() }).0, Confidence::Found);
        // Such a ratio shows no sound valve either, and what hides the gap is said where that is known.
        assert_eq!(said(&Evidence { low: 0.0, ..vague.clone() }).0, Confidence::CannotTell);
        assert_eq!(judge(&Evidence { one_way: true, ..vague }).1, "once");
    }

    #[test]
    fn the_limits_of_what_is_told_are_moved_out() {
        let likely = Evidence { lr_no_gap: 59.0, lr_needed: 60.0, ..plain() };
        let of_four = Evidence { agree: [4, 4], ..plain() };
        for told in [likely, of_four, plain()] {
            let (low, high) = told.limits(&judge(&told).0, Some(1.1));
            assert!((low - 0.9 / LOW_OFF).abs() < 1e-12 && (high.unwrap() - 1.1 * HIGH_OFF).abs() < 1e-12);
        }
        let silent = Evidence { lr_no_gap: LR_MIN, low: 0.0, ..plain() };
        assert_eq!(silent.limits(&judge(&silent).0, Some(1.1)), (0.0, Some(1.1)));
    }

    #[test]
    fn what_speaks_against_a_gap_outweighs_a_ratio() {
        // The gap would take nearly all of OP's range, it is a small part of what OP explains, and PV follows OP within it.
        let against = Plateau { ways: [2; 2], within: 1.0 };
        let wide = Evidence { d: 9.9, low: 9.8, high: Some(10.0), lr_no_gap: 16.0, ..plain() };
        let doubtful = Evidence { plateau: against, noisy_below: 9.0, passes: [5; 2], lr_no_answer: 1e4, ..wide };
        assert_eq!(rules(&doubtful).0, Confidence::Found);
        assert!(doubtful.usual_probability() < PROBABLE, "{}", doubtful.usual_probability());
        assert_eq!((said(&doubtful), judge(&doubtful).1), ((Confidence::CannotTell, None), "outweighed"));
    }

    #[test]
    fn a_swing_is_a_gaps_where_it_is_the_loops_own() {
        let swings = Evidence { even_swing: true, oscillates: true, periodic_load: true, lr_no_gap: 10.0, ..plain() };
        assert_eq!((verdict(&swings), judge(&swings).1), (Verdict::CannotTell, "repeats"));
        let plain_swings = Evidence { even_swing: true, oscillates: true, ..plain() };
        let of = |lr_no_gap| said(&Evidence { lr_no_gap, ..plain_swings.clone() }).0;
        assert_eq!((of(LR_IF_EVEN_SWING), of(501.0)), (Confidence::CannotTell, Confidence::Found));
        assert_eq!(swings.needed(), LR_IF_EVEN_SWING);
        let own = Evidence { cycle: Some(Cycle { period: 1.05, swing: 0.98, law: 0.99 }), ..swings };
        let beside = |lr_no_gap| judge(&Evidence { lr_no_gap, ..own.clone() }).0;
        let clear = beside(LR_IF_CLEAR + 1.0);
        assert_eq!((clear.confidence, clear.oscillates), (Confidence::Likely, true));
        assert_eq!(judge(&Evidence { lr_no_gap: 200.0, low: 0.4, ..own.clone() }).0.confidence, Confidence::CannotTell);
        // A saw may make the fitted loop swing as it was recorded, but no gap is clearly likelier.
        assert_eq!(beside(LR_IF_CLEAR).confidence, Confidence::CannotTell);
        // For a load that repeats itself no width is shared by all families.
        let unsure = Evidence { periodic_load: true, lr_no_gap: 600.0, low: 0.1, ..plain() };
        assert_eq!(judge(&unsure).0.confidence, Confidence::CannotTell);
        assert_eq!(said(&Evidence { periodic_load: false, ..unsure }), (Confidence::Likely, Some(WidthKind::Unsure)));
    }

    #[test]
    fn a_load_that_swings_does_not_hide_a_gap_in_which_pv_moves_against_op() {
        let against = Plateau { ways: [CYCLES; 2], within: OPPOSED - 0.1 };
        let swings = Evidence { even_swing: true, oscillates: true, plateau: against, ..plain() };
        assert_eq!((said(&swings), judge(&swings).1), ((Confidence::Likely, Some(WidthKind::Unsure)), "opposed"));
        for follows in [
            Evidence { plateau: Plateau { within: OPPOSED, ..against }, ..swings.clone() },
            Evidence { plateau: Plateau { ways: [CYCLES, CYCLES - 1], ..against }, ..swings.clone() },
            Evidence { low: NEAR_LOW, ..swings.clone() },
            Evidence { coarse: true, ..swings.clone() },
        ] {
            assert_eq!(said(&follows), (Confidence::CannotTell, None));
        }
        // Where the ratio tells the gap from any load that swings its width is known.
        let clear = Evidence { lr_no_gap: LR_IF_EVEN_SWING + 1.0, ..swings };
        assert_eq!(said(&clear), (Confidence::Found, Some(WidthKind::Interval)));
    }

    #[test]
    fn rows_far_apart_leave_the_width_unsure() {
        let coarse = Evidence { coarse: true, ..plain() };
        assert_eq!((said(&coarse), judge(&coarse).1), ((Confidence::Likely, Some(WidthKind::Unsure)), "coarse"));
        // A PV that stands within the gap and windows that agree make it more probable.
        let stands = Plateau { ways: [8; 2], within: -0.5 };
        assert!(Evidence { plateau: stands, ..coarse.clone() }.usual_probability() > coarse.usual_probability());
        assert!(Evidence { agree: [4, 4], ..coarse.clone() }.usual_probability() > coarse.usual_probability());
        assert_eq!(said(&Evidence { agree: [4, 4], ..coarse }), (Confidence::Found, Some(WidthKind::Interval)));
    }

    #[test]
    fn windows_that_differ_leave_the_width_unsure() {
        let differ = Evidence { dispersion: 2.0 * DISAGREE, agree: [1, 4], shows: Some(4), lr_no_gap: 10.0, ..plain() };
        assert_eq!((judge(&differ).0.confidence, judge(&differ).1), (Confidence::CannotTell, "windows_disagree"));
        let plain_ratio = Evidence { lr_no_gap: 200.0, ..differ };
        let kept = Evidence { agree: [3, 4], ..plain_ratio.clone() };
        assert_eq!((said(&kept), judge(&kept).1), ((Confidence::Likely, Some(WidthKind::Unsure)), "windows_disagree"));
        assert_eq!(judge(&Evidence { shows: None, ..plain_ratio }).1, "recordings_disagree");
        let quiet = Evidence { agree: [3, 4], shows: Some(1), ..plain() };
        assert_eq!((judge(&quiet).0.confidence, judge(&quiet).1), (Confidence::Likely, "windows_silent"));
        assert_eq!(judge(&Evidence { shows: Some(2), ..quiet }).0.confidence, Confidence::Found);
        let of = |part: f64| Evidence { lr_no_gap: part * 100.0, lr_needed: 100.0, ..plain() };
        assert_eq!([of(0.4), of(0.6)].map(|e| said(&e).0), [Confidence::Likely; 2]);
        assert_eq!([of(0.4), of(0.6)].map(|e| e.shows_alone()), [false, true]);
    }

    #[test]
    fn none_seen_is_earned() {
        let none = Evidence { d: 0.0, lr_no_gap: 0.0, low: 0.0, ..plain() };
        let said = |e: Evidence| judge(&e).0.confidence;
        assert_eq!(said(none.clone()), Confidence::NoneSeen);
        assert_eq!(said(Evidence { passes_high: [10, 1], ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { passes_high: [10, 4], ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { passes_high: [10, 4], lag_up_to: 1.6, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { cancels: CANCELS, ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { cancels: CANCELS + 1.0, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { lag_up_to: LAG_UP_TO, ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(said(Evidence { lag_up_to: LAG_UP_TO + 0.1, ..none.clone() }), Confidence::CannotTell);
        assert_eq!(said(Evidence { lr_no_gap: LR_SEEN, lr_needed: 1800.0, ..none.clone() }), Confidence::NoneSeen);
        assert_eq!(
            said(Evidence { lr_no_gap: LR_SEEN + 0.1, lr_needed: 1800.0, ..none.clone() }),
            Confidence::CannotTell
        );
        assert_eq!(said(Evidence { lag_up_to: 1.6, oscillates: true, ..none }), Confidence::CannotTell);
    }

    #[test]
    fn a_load_that_undoes_the_valve_may_be_the_gap() {
        let undone = Evidence { cancels: CANCELS + 1.0, ..plain() };
        assert_eq!(rules(&undone), (Confidence::CannotTell, "cancelled"));
        assert_ne!(judge(&undone).0.confidence, Confidence::Found);
    }

    #[test]
    fn each_passage_asks_for_more_and_so_do_few() {
        assert_eq!(plain().needed(), 15.0);
        assert_eq!(lr_asked([10, 10]), LR_MIN);
        assert_eq!(lr_asked([100, 100]), 200.0 * LR_EACH_PASS);
        assert_eq!(lr_asked([100, CYCLES - 1]), LR_IF_SELDOM);
    }
}
