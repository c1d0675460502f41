//! Every number that decides a verdict or the limits of an interval, with its unit and where it comes from.
//!
//! A likelihood ratio, short LR, is −2·Δln L against the best width. *Truth* is `bench.truth`: unless another number stands
//! there, chosen on the first 30 records of each of 46 kinds, 1380 in all, and judged on the 3772 after them (`docs/fit.md`).
//! *Loads* is `bench.loads`: unless other numbers stand there, chosen on numbers 0 to 232 of each of 12 rows, judged on 330
//! to 529 (`docs/truth.md`).
//! None of them is a theorem.

/// A constant for each, and all of them in a table.
macro_rules! thresholds {
    ($($(#[$doc:meta])* $name:ident: $type:ty = $value:expr, $unit:literal;)*) => {
        $($(#[$doc])* pub(crate) const $name: $type = $value;)*

        /// Name, value and unit of every threshold.
        pub const THRESHOLDS: &[(&str, f64, &str)] = &[$((stringify!($name), $value as f64, $unit)),*];
    };
}

thresholds! {
    /// LR of no gap that a gap must exceed, and LR of a process that does not answer OP that a record must have. Half a chi-square (d = 0
    /// lies at the border of what d can be) exceeds 20 once in 200 000 records; real loads and innovations are not that tame. Truth: 0.8 %
    /// false alarms of 1120 records without a gap, on all of which it was chosen; 1.4 % of 1000 further ones. With 12, and without
    /// [`SAMPLES_IN_LAG`] and [`NOISY`], 3.0 % (ADR 0010).
    LR_MIN: f64 = 15.0, "−2·ln L";
    /// LR of no gap where OP went through the width fewer than [`CYCLES`] times each way: few break-aways may look like anything.
    /// Also for a valve's position that turned but once, and where PV moves against OP within the gap. With 45 one more of 389 records
    /// without a gap is found, with 80 no gap less is found (ADR 31).
    LR_IF_SELDOM: f64 = 60.0, "−2·ln L";
    /// LR of no gap for each of as many steps or bends of the load as OP went through the width. Loads.
    LR_EACH_CHANGE: f64 = 8.0, "−2·ln L";
    /// LR of no gap for each time that OP goes through the width: a model that is a little off brings a little each time, and no record is
    /// too long for that. `bench.lengths --times`, numbers 0 to 2: loops without a gap have reached 0.4 (ADR 0020).
    LR_EACH_PASS: f64 = 0.5, "−2·ln L";
    /// LR of no gap for each cell where the lower limit is not near: the longer a record, the more bends of its load a gap makes up for. 400
    /// records without a gap whose load bends at even times, and parts C and F: with it 9 and 12 of 1049 are found and likely, without it
    /// 26 and 34; of 410 identifiable gaps 138 and 55 in place of 151 and 71 (ADR 35).
    LR_EACH_CELL: f64 = 0.02, "−2·ln L";
    /// Probability of a gap, where as many valves have one as usual, that one needs to be found or likely. Parts A to C, 1203 records without a
    /// gap, twins left out: with it 12 are found and 16 more are likely, with 0.7 10 and 18, and of 817 gaps 253 in place of 266 are found
    /// (ADR 32).
    PROBABLE: f64 = 0.5, "1";
    /// Probability of a gap, where as many valves have one as usual, above which no valve is sound: all evidence must halve what is so
    /// usually. A valve with a gap of 2.8 % that was called sound has 0.15; 4 of 124 rightly called so or *none seen* have more (ADR 38).
    IMPROBABLE: f64 = 0.125, "1";
    /// Part of the most likely width that the lower limit must exceed for a gap to be told at a ratio below [`LR_EACH_CELL`]: a load that bends
    /// makes each swing of OP look like a gap of another width, and a gap has one (ADR 35). Also where the recorded cycle is the loop's own:
    /// driven loops had a lower limit of 0.37 of the width, gaps 0.71 and more.
    NEAR_LOW: f64 = 0.65, "1";
    /// Factor by which the lower limit of a found or likely width is moved down: models are a little off. Part A and another
    /// simulation: with both limits moved so, of 102 intervals of found gaps 98 hold in place of 94 (ADR 31).
    LOW_OFF: f64 = 1.05, "1";
    /// Factor by which the upper limit is moved up. A valve that sticks overshoots as it breaks loose, so its fitted width is less
    /// than a slow sweep shows. Parts A to D: 153 of 161 intervals of found gaps hold, 142 with [`LOW_OFF`] in its place (ADR 32).
    HIGH_OFF: f64 = 1.1, "1";
    /// LR of no gap below which an OP that swings evenly may be a load's: loads without a gap have reached 347 (loads, driven loops; ADR 31).
    LR_IF_EVEN_SWING: f64 = 500.0, "−2·ln L";
    /// LR of no gap where the recorded cycle is the loop's own, and from which on no bootstrap is made. Own cycles of a gap have 124 and
    /// more. Loads that make the same period and swing had at most 89 in part A, and 223 to 285 in five loops of parts B and C (ADR 32).
    LR_IF_CLEAR: f64 = 100.0, "−2·ln L";
    /// Travel of PV with OP within the gap, part of |Kp| times OP's travel, below which PV moves against OP. Parts C, F, G and the records that
    /// the weights are learned from, OP swings, a ratio above 60 and a lower limit above [`NEAR_LOW`]: below it 18 gaps and 1 record
    /// without one; above it 16 and 14 (ADR 36).
    OPPOSED: f64 = -0.1, "1";
    /// LR of no gap over all records that share a width, times their dispersion. Loads, and `bench.lengths` (ADR 0012).
    LR_JOINT: f64 = 32.0, "−2·ln L";
    /// LR of no gap above which a family that predicts nearly as well as the best sees one, and no valve is sound. Simulations
    /// and real loops.
    LR_SEEN: f64 = 12.0, "−2·ln L";
    /// LR of J = 0 that a slip jump must exceed. Truth: the cause is right in 26 % of the records where it can be seen.
    LR_JUMP: f64 = 20.0, "−2·ln L";
    /// LR that a slip jump needs to be taken into the most likely width: it has a size, a kind and a width of its own.
    /// No bench of its own.
    JUMP_PRICE: f64 = 4.0, "−2·ln L";

    /// Rise of −2·ln L within the 95 % interval. A chi-square would say 3.84; loads that are no random walk and processes
    /// of no family make it rise so far at the true width in one of twenty records of mere backlash. Truth: the
    /// interval holds d in 98 %.
    RISE: f64 = 8.0, "−2·ln L";
    /// Rise of −2·ln L within the interval of a valve that sticks: the moment it breaks loose depends on moves of OP between
    /// samples. Truth: the interval holds d in 91 %.
    RISE_OF_STICKING: f64 = 16.0, "−2·ln L";
    /// Rise of −2·ln L within which gain, dead time and lags count for their limits: a chi-square of one degree of freedom.
    RISE_OF_PROCESS: f64 = 3.84, "−2·ln L";
    /// Factor by which the limits of gain and lags are moved out besides, and by as much of lags and dead time together those of the dead
    /// time. Half A of `bench.ordinary`, 21 found gaps: without it they hold in 15, 16 and 17, with it in 17, 20 and 20.
    PROCESS_OFF: f64 = 1.08, "1";
    /// Factor for the limits of gain and lags where no gap is found. Gain and lags may then also be as much greater as a load of
    /// [`CANCELS`] allows (ADR 31).
    PROCESS_OFF_IF_NOT_FOUND: f64 = 3.0, "1";
    /// Factor of the allowed rise where as many steps or bends of the load were marked as OP went through the width. Loads.
    RISE_BESIDE_CHANGES: f64 = 3.0, "1";
    /// Distance by which the upper limit is moved up, in halves of OP's median move from one sample to the next: turns between two
    /// samples are missed, and a gap looks narrower. `bench.lengths --times`, numbers 0 to 4: with 3, processes with lags of two to
    /// five samples missed by 0.2 to 4 % (ADR 20).
    MISSED_TURNS: f64 = 5.0, "1";
    /// Less trust than this is not believed: it rests on the few cells that matter for d. Simulations and real loops.
    LEAST_INFORMATION_RATIO: f64 = 0.4, "1";
    /// Trust below which PV strays from the model where the valve turns: it may stick as well. FIC46005 has 0.4; the 76 gaps that are
    /// found in numbers 100 to 114 of eight rows of loads have 0.57 or more.
    MISFIT_AT_TURNS: f64 = 0.5, "1";
    /// The same below which no valve is sound: a load that OP answers may look like the valve's answer to OP, but not where OP turns. Of
    /// five valves that stand still and were called sound four have less, and 47 of 191 rightly called so or *none seen* (ADR 38).
    INFORMATION_RATIO_IF_SOUND: f64 = 0.95, "1";
    /// Families no further behind the best than this, and [`AS_GOOD`], are believed: a gap must show in all of them, and the
    /// interval holds all of theirs. Simulations and real loops.
    BELIEVED: f64 = 6.0, "−2·ln L";
    /// Relative excess of their innovations that is allowed as well. Simulations and real loops.
    AS_GOOD: f64 = 0.0035, "1";
    /// A lower limit less than this part of the most likely width is none. No bench of its own.
    LEAST_LOW: f64 = 0.2, "1";
    /// Part of OP's range below which the interval of a sound valve must end. No bench of its own.
    SOUND_BELOW: f64 = 0.25, "1";
    /// Mean moves of OP from one sample to the next that may hide a gap: OP moves as far between them, unseen, and shakes the valve
    /// through it. `bench.lengths --times`, number 2 (ADR 0020).
    UNSAMPLED_BELOW: f64 = 3.0, "1";
    /// Part of OP's range below which a gap is none, however plain: models are off by as much. The same (ADR 0020).
    TRIFLE: f64 = 0.01, "1";

    /// Traversals each way of a width for a likelihood ratio of [`LR_MIN`] to be enough, and for a slip jump to be looked for. That of the
    /// bench's identifiable gaps.
    CYCLES: usize = 5, "traversals";
    /// Traversals each way of a gap that is plain, turns of a valve whose position is recorded, and turns through the limit of one in
    /// which no gap is seen. Simulations and real loops.
    CYCLES_IF_CLEAR: usize = 2, "traversals";

    /// Greatest correlation of innovations with those a cell before: no model that leaves more of PV unexplained is believed.
    /// Simulations and real loops.
    MAX_AUTOCORRELATION: f64 = 0.25, "1";
    /// Mean sizes of an innovation that it counts as at most there: outliers are no echo. Loads, outliers 18 and 209.
    ECHO_OF_ONE: f64 = 3.0, "1";
    /// Samples that a process must take to settle: what OP did between fewer explains as much as a gap. Truth: without it and
    /// [`NOISY`] 4.3 % of what was said of gaps that cannot be told was false, with them and [`LR_MIN`] 2.7 % (ADR 0010).
    SAMPLES_IN_LAG: f64 = 5.0, "samples";
    /// Least samples in a lag for a valve that is sound. Loads, numbers 233 to 329: PV filtered beside the controller, squares
    /// through a lag.
    SAMPLES_IN_LAG_IF_SOUND: f64 = 4.0, "samples";
    /// Samples in which OP goes through the gap, by its mean move, from which on that does not matter. FIC46005 (ADR 0010).
    SAMPLES_IN_GAP: f64 = 25.0, "samples";
    /// Samples that it must take in any case: where it settles within fewer, a load that ramps leaves PV as a gap does.
    /// `bench.loads.sparse`, chosen on numbers 300 to 309, judged on 310 to 319 (ADR 0010).
    SAMPLES_IN_LAG_AT_LEAST: f64 = 0.9, "samples";
    /// Standard deviations of PV's noise that a gap must make of PV for a record to be plain. That of the bench's
    /// identifiable gaps (ADR 0010).
    NOISY: f64 = 3.0, "σ";
    /// Part of the width that the model's valve must move: else it is a step of PV at a time and of a size that are free. FIC20102.
    MOVES: f64 = 0.1, "1";
    /// Spread of the times from one traversal to the next the same way, part of their mean, below which OP swings evenly.
    /// Loads: triangles and a neighbour's cycle (ADR 0012).
    EVEN_SWING: f64 = 0.3, "1";
    /// Standard deviation of the setpoint, part of that of PV, from which on it leads PV, and an OP that swings evenly is no load's alone.
    /// Truth, the first 24 records of every kind; judged by `bench.loads.led`, numbers 24 to 35 (ADR 0012).
    LED: f64 = 0.25, "1";
    /// Share of OP's moves that the law of the controller must explain for the fitted loop to be run with it. Half A of `bench.ordinary`:
    /// 0.99 where a PI controller's own OP and PV are recorded, below 0.5 under periods in manual.
    LAW: f64 = 0.8, "1";
    /// Relative difference of period and swing of the fitted loop without a load from the recorded ones, within which the swing is its own.
    /// Chosen on the loops of tests/ladder.py and part A of `bench.ordinary`: 0.92 to 1.14 and 0.94 to 1.02 of 26 limit cycles of a gap.
    OWN_CYCLE: f64 = 0.15, "1";
    /// Part of OP's range through which OP swings where it is said to oscillate.
    OSCILLATES: f64 = 0.3, "1";
    /// Fewest of these times. Loads.
    FEWEST_SWINGS: usize = 6, "swings";
    /// Ratio to the bow of its lines that a gap must make of a PV drawn by a historian. Loads, swinging door.
    LINED_BELOW: f64 = 10.0, "1";
    /// Greatest share of corners between lines among the moving samples of such a PV. Loads, swinging door.
    CORNERS: f64 = 0.4, "1";

    /// Upper limit of the lags, a ratio to the best lags, above which no gap is seen. Parts C, F and G of `bench.ordinary`: 23 in the
    /// valve that was wrongly called sound with rows two lags apart; 7 of 193 rightly called so or *none seen* have more than 3.
    LAG_UP_TO: f64 = 3.0, "1";
    /// The same where OP oscillates, or goes through the limit less than [`CYCLES`] times a way. Half A: 1.65 and 1.47 by the curvature
    /// alone in the two valves that were wrongly called sound there. Parts C, F and G: 6 of 37 rightly called so have more, all of them
    /// *none seen* but one.
    LAG_UP_TO_IF_FEW: f64 = 1.4, "1";
    /// Kp·sd(OP)/sd(PV) above which a load undoes what the valve does: no gap is found, and no valve is sound. No gain is taken to be
    /// greater. Of 1203 records without a gap, parts A to C, 12 in place of 14 are found, of 817 gaps 5 fewer (ADR 32). With 12 for a
    /// sound valve 19 fewer of 254 are called *none seen*, and none of 16 gaps fewer (ADR 37).
    CANCELS: f64 = 30.0, "1";

    /// Fewest steps of a load: fewer may each be the valve that breaks loose late (ADR 0009). Simulations.
    FEWEST_STEPS: usize = 5, "steps";
    /// Fewest bends of a load along lines. Loads (ADR 0012).
    FEWEST_BENDS: usize = 2, "bends";
    /// Cells to a step or bend at least: a load that changes oftener is not one whose changes can be told (ADR
    /// 0009). Simulations.
    CELLS_A_CHANGE: usize = 40, "cells";
    /// Price of a change of the load, beside those of its size and its place. `bench.loads`, number 600: with 0, 3, 6 and 10 seven, seven,
    /// eight and seven of 14 gaps are found, and none, none, none and two where there is none.
    PRICE_OF_CHANGE: f64 = 6.0, "−2·ln L";
    /// LR of a step in a load that walks. Simulations and real loops.
    LARGE_STEP: f64 = 50.0, "−2·ln L";
    /// Size of such a step as a ratio to the gap: a smaller one may be the valve. Simulations.
    WIDER_THAN_GAP: f64 = 1.2, "1";
    /// Traversals of the gap each way to a step that may be smaller. The limit cycles of `tests/ladder.py`, which begin with one.
    TRAVERSALS_A_STEP: usize = 4, "1";
    /// Of n steps more than n/2 + 0.82·√n go with OP in 5 % of loads, which know nothing of OP. FIC46005: 21 of 25.
    ALONG_OP: f64 = 0.82, "1";
    /// The same of steps that leave no gap: more than n/2 + 1.55·√n go with OP in 0.1 % of loads, so chance alone takes no load from
    /// what a gap has to beat.
    ALONG_OP_WITHOUT: f64 = 1.55, "1";

    /// Mean rise of −2·ln L over the width of all records that is no disagreement. `bench.lengths` (ADR 0012).
    AGREES: f64 = 4.0, "−2·ln L";
    /// Dispersion of records of one width from which on they disagree. `bench.lengths` (ADR 0012).
    DISAGREE: f64 = 5.0, "1";
    /// Relative distance of a record's own width from that of all within which it agrees.
    AGREES_WITH: f64 = 0.2, "1";
    /// Part of the variance of a record's width that is common to all recordings of one valve, since their models lack the same.
    /// `bench.ordinary --several`, 20 loops of seed 57: eight days hold the width in 9 of 12 with 0, in 11 with 0.2 (ADR 16).
    SHARED_ERROR: f64 = 0.2, "1";
    /// Share of the records that must agree for what each alone could not say to count.
    AGREE: f64 = 2.0 / 3.0, "1";
    /// Recordings of one valve that must count for a joint width: what fewer say rests on one of them. Chosen on real exports,
    /// judged by `bench.recordings` (`docs/truth.md`).
    FEWEST_RECORDINGS: usize = 3, "recordings";
    /// Rows in a row that stand in an earlier recording to the last digit, and different values of PV among them, that are a replay
    /// of it. Real exports.
    REPEATED_ROWS: usize = 8, "rows";
    /// See [`REPEATED_ROWS`].
    REPEATED_LEVELS: usize = 5, "values";
    /// Windows of a history that must show a gap by themselves, part of all: what no window shows may be what the model lacks in all
    /// of them. `bench.lengths --times`, numbers 0 to 2 (ADR 0020).
    WINDOWS_THAT_SHOW: f64 = 1.0 / 3.0, "1";
    /// Part of the LR needed above which a window shows a gap by itself, where it is likely there. What was enough for a likely gap when
    /// [`WINDOWS_THAT_SHOW`] was chosen.
    WINDOW_SHOWS: f64 = 0.5, "1";
    /// Widths that a change in time must rest on, and its standard errors: with the widths' own errors known, 2 to 3 of 1000 steady
    /// widths are said to change; where only their scatter is, by Student's distribution as many (`decide::trend`).
    TREND_WIDTHS: usize = 5, "widths";
    /// See [`TREND_WIDTHS`].
    TREND_ERRORS: f64 = 3.0, "standard errors";

    /// Share of the position's variance that its model must explain. P1 to P8 under five recorders: 240 records, no miss.
    POSITION_EXPLAINED: f64 = 0.5, "1";
    /// Share of the width above which all of it is slip jump, by the position. No bench of its own.
    POSITION_ALL_JUMP: f64 = 0.95, "1";
}
