//! Kind of each move from one settled hold to the next, and the side from which it presses the valve.

use super::holds::Node;
use super::posterior::Posterior;
use super::{Evidence, Kind};

/// One-sided probability below which PV counts as having answered a move: of a dozen moves one is taken wrongly in 200
/// tests.
const SURE: f64 = 5e-4;

/// A move between two settled holds (their places among the settled ones).
#[derive(Clone, Copy, Debug)]
pub(super) struct Move {
    pub(super) kind: Kind,
    pub(super) origin: usize,
    pub(super) to: usize,
    /// The last hold at which the valve is known to have been pressed; from there on OP may have gone back and forth within the
    /// dead band.
    pub(super) since: Option<usize>,
    /// OP's move from the origin [OP unit].
    pub(super) travel: f64,
    /// Why it gives nothing.
    pub(super) why: Option<Evidence>,
}

impl Move {
    /// Whether PV did not answer the move.
    pub(super) fn unanswered(&self) -> bool {
        self.why == Some(Evidence::Unanswered)
    }
}

/// Walks the settled holds; `sign` is that of Kp, `ends` picks the level of each hold out of `free`. Sets the side of each hold.
pub(super) fn moves(
    nodes: &mut [Node],
    op: &[f64],
    tolerance: f64,
    free: &Posterior,
    ends: &[Vec<f64>],
    sign: f64,
) -> Vec<Move> {
    let mut moves = Vec::new();
    let mut since: Option<usize> = None;
    for i in 0..nodes.len() - 1 {
        let (a, b, to) = (nodes[i], nodes[i + 1], i + 1);
        if i == 0 || nodes[i - 1].stretch != a.stretch {
            since = None;
        }
        if a.stretch != b.stretch {
            since = None;
            continue;
        }
        if !straight(op, &a, &b, tolerance) {
            since = None;
            let (travel, why) = (b.op - a.op, Some(Evidence::Turned));
            moves.push(Move { kind: Kind::None, origin: i, to, since, travel, why });
            continue;
        }
        let origin = since.unwrap_or(i);
        let travel = b.op - nodes[origin].op;
        if let Some(pressed) = since.filter(|_| travel.abs() <= tolerance) {
            // Back where it was pressed.
            nodes[to].side = nodes[pressed].side;
            since = Some(to);
            continue;
        }
        if (b.op - a.op).abs() <= tolerance {
            continue;
        }
        let direction: i8 = if travel > 0.0 { 1 } else { -1 };
        if since.is_some_and(|pressed| nodes[pressed].side == direction) {
            nodes[to].side = direction;
            moves.push(Move { kind: Kind::Gain, origin, to, since, travel, why: None });
            since = Some(to);
            continue;
        }
        let change = difference(&ends[to], &ends[origin], sign * f64::from(direction));
        let contrary = free.below(0.0, &change);
        if contrary > 1.0 - SURE {
            moves.push(Move { kind: Kind::None, origin, to, since: None, travel, why: Some(Evidence::Opposite) });
            since = None;
        } else if contrary > SURE {
            moves.push(Move { kind: Kind::None, origin, to, since, travel, why: Some(Evidence::Unanswered) });
        } else {
            nodes[to].side = direction;
            let (kind, why) = match since {
                None => (Kind::None, Some(Evidence::FirstMove)),
                Some(_) => (Kind::Gap, None),
            };
            moves.push(Move { kind, origin, to, since, travel, why });
            since = Some(to);
        }
    }
    moves
}

/// Difference (a − b)·sign of two weight vectors, one number a level.
pub(super) fn difference(a: &[f64], b: &[f64], sign: f64) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| (a - b) * sign).collect()
}

/// Whether OP went from one hold to the other without turning.
fn straight(op: &[f64], a: &Node, b: &Node, tolerance: f64) -> bool {
    let direction = if b.op >= a.op { 1.0 } else { -1.0 };
    let mut furthest = f64::NEG_INFINITY;
    op[a.end - 1..=b.first].iter().all(|op| {
        furthest = furthest.max(op * direction);
        furthest - op * direction <= tolerance
    })
}

#[cfg(test)]
mod tests {
    use super::super::posterior::Axes;
    use super::super::posterior::tests::two_holds;
    use super::*;

    /// Verdict on the first move, given the probability that PV did not answer.
    fn evidence_at(contrary: f64) -> Option<Evidence> {
        let free = |step: f64| {
            let blocks = two_holds(step, 0.1, 0.0);
            Posterior::of(&blocks.levels(), &Axes::of(&blocks).unwrap(), 0.0, 1.0).unwrap()
        };
        let ends = [vec![1.0, 0.0], vec![0.0, 1.0]];
        let (mut low, mut high) = (-3.0, 3.0);
        for _ in 0..60 {
            let half = f64::midpoint(low, high);
            let below = free(half).below(0.0, &difference(&ends[1], &ends[0], 1.0));
            *(if below > contrary { &mut low } else { &mut high }) = half;
        }
        let op: Vec<f64> = (0..20).map(|k| if k < 10 { 50.0 } else { 54.0 }).collect();
        let node = |i: usize| Node {
            first: 10 * i,
            end: 10 * (i + 1),
            stretch: 0,
            op: op[10 * i],
            settled: Some(10 * i),
            side: 0,
        };
        moves(&mut [node(0), node(1)], &op, 0.01, &free(low), &ends, 1.0)[0].why
    }

    #[test]
    fn pv_answers_where_the_contrary_is_less_likely_than_one_in_two_thousand() {
        assert_eq!(
            [evidence_at(0.5), evidence_at(6e-4), evidence_at(4e-4)],
            [Some(Evidence::Unanswered), Some(Evidence::Unanswered), Some(Evidence::FirstMove)]
        );
        assert_eq!(
            [evidence_at(1.0 - 6e-4), evidence_at(1.0 - 4e-4)],
            [Some(Evidence::Unanswered), Some(Evidence::Opposite)]
        );
    }
}
