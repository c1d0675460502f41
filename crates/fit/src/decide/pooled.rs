//! Evidence of several records of one valve, as far as it does not depend on the width that they share.

use crate::decide::evidence::Evidence;
use crate::decide::witness::plateau::Plateau;

/// The evidence that most records have, or the middle of theirs.
///
/// - `records`: at least one, each with the size of its unit of OP.
///
/// All else is that of the clearest record, above all what depends on the width: d, limits, likelihood ratios and traversals.
pub(super) fn pooled(records: &[(&Evidence, f64)]) -> Evidence {
    let n = records.len();
    let number = |of: fn(&Evidence) -> bool| records.iter().filter(|(e, _)| of(e)).count();
    let most = |of: fn(&Evidence) -> bool| 2 * number(of) > n;
    let mean = |of: fn(&Evidence) -> f64| records.iter().map(|(e, _)| of(e)).sum::<f64>() / n as f64;
    let median = |of: fn(&Evidence) -> f64| middle(records.iter().map(|(e, _)| of(e)).collect());
    let width = |of: fn(&Evidence) -> f64| middle(records.iter().map(|(e, size)| of(e) * size).collect());
    let each = records.iter().map(|(e, _)| *e);
    let clearest = each.max_by(|a, b| a.lr_no_gap.total_cmp(&b.lr_no_gap)).expect("there are records");
    let mut all = Evidence {
        autocorrelation: mean(|e| e.autocorrelation),
        lr_no_answer: mean(|e| e.lr_no_answer),
        immobile: most(|e| e.immobile),
        coarse: most(|e| e.coarse),
        at_once: most(|e| e.at_once),
        noisy_below: width(|e| e.noisy_below),
        information_ratio: median(|e| e.information_ratio),
        slips_wholly: most(|e| e.slips_wholly),
        periodic_load: most(|e| e.periodic_load),
        even_swing: most(|e| e.even_swing),
        unsampled_below: width(|e| e.unsampled_below),
        lined_below: width(|e| e.lined_below),
        hidden: records.iter().find_map(|(e, _)| e.hidden).filter(|_| most(|e| e.hidden.is_some())),
        // A third is enough here: it keeps a valve from being called sound.
        dissent: 3 * number(|e| e.dissent) > n,
        oscillates: most(|e| e.oscillates),
        cancels: median(|e| e.cancels),
        lag_up_to: median(|e| e.lag_up_to),
        ..clearest.clone()
    };
    // That PV moves against OP in one record says nothing of a load that swings in the others.
    if all.is_led_by_a_swing() && !most(Evidence::is_led_by_a_swing) {
        all.plateau = Plateau::default();
    }
    all
}

/// The upper one of the two middle values where their number is even.
fn middle(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    of[of.len() / 2]
}
