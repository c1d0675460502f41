"""Evidence weighed: a probability, its parts, and a prior that moves no rung."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from bench.weigh.model import Lines, auc, balanced, learned, left_out, log_loss
from bench.weigh.table import rust

import glapp
from glapp import _glapp
from glapp.errors import InputError


@pytest.fixture(scope="module")
def recording() -> glapp.Recording:
    """A loop with a gap under a load that steps."""
    acting = {"setpoint": [(1, 1.0)], "load": [(50, 0.3), (100, -0.2), (150, 0.25)]}
    sim = glapp.simulate.closed_loop("P3", (0.48, 0.3117), d=0.05, noise=0.005, h=0.1, t_end=200, seed=1, **acting)
    table = {"t": sim.t, "PV": sim.pv, "OP": sim.op, "SP": sim.sp}
    loop = glapp.Loop(name="F", op_span=(0, 2), op_unit="mA", pv_span=(0, 2), controller={"k": 0.48, "ti": 0.3117})
    return glapp.recording_from(table, loop)


class TestAnswer:
    def test_the_log_odds_are_the_sum_of_base_and_terms(self, recording: glapp.Recording) -> None:
        fit = glapp.fit(recording)
        assert fit.weighed is not None
        weighed = _glapp.fit_weighed(json.dumps(fit.best["evidence"]))
        factor, terms = fit.weighed["log_bayes_factor"], fit.weighed["terms"]
        assert factor == pytest.approx(weighed["log_bayes_factor"])
        each = [worth for _, _, worth in weighed["quantities"].values()]
        assert sum(terms.values()) == pytest.approx(sum(each))

    def test_more_likelihood_is_never_less_probable(self, recording: glapp.Recording) -> None:
        evidence = dict(glapp.fit(recording).best["evidence"])
        found = []
        for ratio in (0.0, 5.0, 20.0, 100.0, 1000.0, 1e6, 1e9):
            evidence |= {"lr_no_gap": ratio}
            found.append(_glapp.fit_weighed(json.dumps(evidence))["log_bayes_factor"])
        assert found == sorted(found) and found[0] < found[-1]
        assert found[-1] == pytest.approx(found[-2]), "beyond what was learned a term counts no more"

    def test_what_no_model_explains_is_not_weighed(self, recording: glapp.Recording) -> None:
        evidence = dict(glapp.fit(recording).best["evidence"])
        for bad in ({"autocorrelation": 0.3}, {"lr_no_answer": 1.0}):
            assert _glapp.fit_weighed(json.dumps(evidence | bad))["log_bayes_factor"] is None

    def test_the_prior_moves_the_probability_and_no_rung(self, recording: glapp.Recording) -> None:
        loop = recording.loop
        decided = {}
        fit = glapp.fit(recording)
        for prior in (None, 5.0, 80.0):
            given = loop if prior is None else glapp.Loop(**(loop.model_dump() | {"dead_band_prior": prior}))
            decided[prior] = glapp.result.decide(
                crossings="no_estimate", d_hat=None, detections=0, reasons={}, fit=fit, loop=given
            )
        usual, low, high = decided.values()
        assert usual.prior == 0.25 and low.prior == 0.05 and high.prior == 0.8
        assert low.p_gap is not None and usual.p_gap is not None and high.p_gap is not None
        assert 0.02 <= low.p_gap < usual.p_gap <= high.p_gap <= 0.98
        assert usual.log_bayes_factor is not None
        odds = usual.log_bayes_factor + math.log(0.25 / 0.75)
        assert usual.p_gap == pytest.approx(min(1 / (1 + math.exp(-odds)), 0.98))
        assert {answer.confidence for answer in decided.values()} == {usual.confidence}
        assert usual.p_beyond is not None and usual.p_beyond <= usual.p_gap

    def test_a_prior_is_a_share_of_valves(self) -> None:
        with pytest.raises(InputError, match="dead_band_prior"):
            glapp.Loop(name="F", dead_band_prior=100)


class TestModel:
    """The lines, on records that are drawn from known ones."""

    rng = np.random.default_rng(7)
    x = rng.normal(size=(4000, 3))
    odds = 2.0 * np.clip(x[:, 0], -1, 1) - 1.5 * (x[:, 1] > 0)
    gap = rng.random(4000) < 1 / (1 + np.exp(-odds))
    weight = np.ones(4000)
    rises = np.array([True, False, True])

    def test_finds_what_the_records_were_drawn_from(self) -> None:
        lines = learned(self.x, self.rises, self.gap, self.weight)
        assert np.corrcoef(lines.log_odds(self.x), self.odds)[0, 1] > 0.93
        assert np.ptp(lines.y[2]) < 0.5, "the third quantity tells nothing"
        for up, y in zip(self.rises, lines.y, strict=True):
            assert (np.diff(y) >= 0).all() if up else (np.diff(y) <= 0).all()
        assert lines.heights(self.x).mean(axis=0) == pytest.approx(0.0, abs=1e-9)

    def test_a_quantity_the_wrong_way_gets_no_weight(self) -> None:
        lines = learned(self.x, ~self.rises, self.gap, self.weight)
        assert np.ptp(lines.y[0]) < 1e-6 and np.ptp(lines.y[1]) < 1e-6

    def test_what_is_left_out_is_not_learned_from(self) -> None:
        groups = np.array(["a", "b"])[(np.arange(4000) % 2)]
        odds = left_out(self.x, self.rises, self.gap, self.weight, groups)
        half = groups == "a"
        other = learned(self.x[~half], self.rises, self.gap[~half], self.weight[~half])
        assert odds[half] == pytest.approx(other.log_odds(self.x[half]))

    def test_half_of_each_row_has_a_gap(self) -> None:
        gap, rows = np.array([True, False, False, True, True]), np.array(["a", "a", "a", "b", "b"])
        assert balanced(gap, rows) == pytest.approx([1.5, 0.75, 0.75, 0.0, 0.0])

    def test_auc_and_log_loss_by_definition(self) -> None:
        odds, gap, one = np.array([1.0, 2.0, 2.0, 3.0]), np.array([False, True, False, True]), np.ones(4)
        assert auc(odds, gap, one) == pytest.approx((1 + 0.5 + 1 + 1) / 4)
        assert log_loss(np.zeros(4), gap, one) == pytest.approx(math.log(2))

    def test_the_table_leaves_out_what_lies_on_a_level_line(self) -> None:
        lines = Lines(0.25, [np.array([0.0, 1.0, 2.0, 3.0])], [np.array([-1.0, -1.0, -1.0, 2.0])])
        assert '    ("q", &[[0.0, -1.0], [2.0, -1.0], [3.0, 2.0]]),' in rust(["q"], lines, "a fit")
