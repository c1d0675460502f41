"""The detector's pass as one plain function: run by Python as it stands, and by numba compiled.

The same checks, half-period record, safety net and filter of detections as `glapp_core::Detector`, in the same order of
operations, so that both give the same bits. Nothing that the compiler can do is left out: no fast-math in either.
"""

from __future__ import annotations

import math
from typing import Any

GAP, BAD, NOT_AUTO, LIMITS = 16, 2, 1, 12
SHORT_KEPT = 50_000
COLUMNS = 20


def median_mean(window: Any, ordered: Any, count: int) -> float:
    """Mean of the detections within 80-120 % of their median."""
    for i in range(count):
        x = window[i]
        at = i
        while at > 0 and ordered[at - 1] > x:
            ordered[at] = ordered[at - 1]
            at -= 1
        ordered[at] = x
    half = count // 2
    median = ordered[half] if count % 2 == 1 else (ordered[half - 1] + ordered[half]) / 2.0
    band = 0.2 * abs(median)
    total, kept = 0.0, 0
    for i in range(count):
        if abs(ordered[i] - median) <= band:
            total += ordered[i]
            kept += 1
    return median if kept == 0 else total / kept


def detect(
    t: Any,
    sp: Any,
    pv: Any,
    op: Any,
    flags: Any,
    settings: tuple[float, float, float, float, int, float, float],
    work: tuple[Any, Any, Any],
    reasons: Any,
    out: Any,
) -> tuple[int, float, int]:
    """Fill `reasons` and the rows of `out`; give their number, the estimate and the detections in its window.

    `settings` are K, Ti, Kp, Tf, N, max_h, span of OP; PI only (Td = 0, b = 1). `work` holds three arrays of N.
    """
    k_abs, ti, kp, tf, n_window, max_h, span = settings
    window, candidates, ordered = work
    y1 = y2 = u1 = u2 = 0.0
    before = t[0]
    start = t[0]
    broken = GAP
    started = False
    sign = 0
    # the half-period under way
    n, met = 0, 0
    delta_t = integral = e_max = sp_low = sp_high = sp_start = slope_start = op_start = 0.0
    # what is remembered from one half-period to the next
    previous = math.nan
    estimate = math.nan
    place = count = 0
    candidate_place = candidate_count = rejected = 0
    rows = short = 0
    for k in range(len(t)):
        h = t[k] - before
        x, w = pv[k], sp[k]
        flag = 0
        if flags is not None:
            flag = flags[k]
        good = flag & BAD == 0 and math.isfinite(w) and math.isfinite(x)
        if op is not None:
            good = good and math.isfinite(op[k])
        ended = False
        cause = 0
        slope = op_now = 0.0
        closed_sign = sign
        closed_flags = met
        end = t[k]
        if broken == 0 and h > 0.0 and h <= max_h and good:
            a = h / (tf + h)
            y_before = y2
            y1 += (x - y1) * a
            y2 += (y1 - y2) * a
            if op is not None:
                u1 += (op[k] - u1) * a
                u2 += (u1 - u2) * a
                op_now = u2
            e = w - y2
            if e > 0.0:
                now = 1
            elif e < 0.0:
                now = -1
            else:
                now = sign
            if now != sign:
                if sign != 0:
                    ended = True
                    slope = (y2 - y_before) / h
                sign = now
            before = t[k]
        elif h == 0.0 and (started or n > 0):
            met |= flag
            continue
        else:
            in_time = h > 0.0 and h <= max_h
            if broken == 0 or (good and not in_time):
                cause = GAP if good else BAD
                ended = n > 0
                broken = cause
                closed_flags |= cause
            if not in_time:
                end = before
            e = 0.0
            if good:
                y1 = y2 = x
                if op is not None:
                    u1 = u2 = op[k]
                    op_now = u2
                e = w - y2
                sign = 1 if e > 0.0 else (-1 if e < 0.0 else 0)
                started = True
            else:
                broken |= BAD
                sign = 0
                started = False
            if math.isfinite(h):
                before = t[k]
        if ended:
            delta_y = integral / delta_t if delta_t > 0.0 else 0.0
            if cause != 0:
                delta_sp = sp_high - sp_low
                sp_change = slope_change = op_change = 0.0
            else:
                delta_sp = max(sp_high, w) - min(sp_low, w)
                sp_change, slope_change, op_change = w - sp_start, slope - slope_start, op_now - op_start
            towards = -1.0 if closed_sign < 0 else 1.0
            delta_u = k_abs * delta_y * delta_t / ti
            delta_u_sp = 0.0 * k_abs * sp_change * towards
            delta_u_d = -(k_abs * 0.0 * slope_change * towards)
            op_travel = op_change * towards
            free = delta_u + delta_u_d + delta_u_sp
            kp_part = delta_y / kp
            d = free - kp_part
            asked = estimate if count == n_window else math.nan
            mask = 0
            if closed_flags & GAP:
                mask |= 1
            if closed_flags & BAD:
                mask |= 2
            if closed_flags & NOT_AUTO:
                mask |= 4
            if closed_flags & LIMITS or free >= span:
                mask |= 8
            if delta_t <= 5.0 * ti:
                mask |= 16
            if e_max >= 2.0 * delta_y:
                mask |= 32
            if not (previous < 1.5 * delta_y and previous > 0.5 * delta_y):
                mask |= 64
            if delta_sp >= delta_y:
                mask |= 128
            if delta_t * 2.0 * k_abs * delta_y <= ti * asked:
                mask |= 256
            if mask == 0:
                window[place] = d
                place = place + 1 if place + 1 < n_window else 0
                count = min(count + 1, n_window)
                estimate = median_mean(window, ordered, count)
                rejected = 0
            elif mask == 256:
                if rejected == 0:
                    candidate_place = candidate_count = 0
                candidates[candidate_place] = d
                candidate_place = candidate_place + 1 if candidate_place + 1 < n_window else 0
                candidate_count = min(candidate_count + 1, n_window)
                found = median_mean(candidates, ordered, candidate_count)
                rejected += 1
                near = 0
                for i in range(candidate_count):
                    if abs(candidates[i] - ordered[candidate_count // 2]) <= 0.2 * abs(ordered[candidate_count // 2]):
                        near += 1
                if (candidate_count == n_window and 3 * near >= 2 * n_window) or rejected >= 5 * n_window:
                    for i in range(candidate_count):
                        window[i] = candidates[i]
                    place, count, estimate, rejected = candidate_place, candidate_count, found, 0
            reason = 0
            while mask >> reason & 1 == 0 and reason < 9:
                reason += 1
            reason = 0 if reason == 9 else reason + 1
            reasons[reason] += 1
            if mask & 16 == 0 or short < SHORT_KEPT:
                if mask & 16:
                    short += 1
                row = out[rows]
                row[0], row[1], row[2], row[3], row[4] = start, end, closed_sign, n, delta_t
                row[5], row[6], row[7], row[8], row[9] = delta_y, e_max, delta_sp, delta_u, delta_u_d
                row[10], row[11], row[12], row[13], row[14] = delta_u_sp, op_travel, free, kp_part, d
                row[15], row[16], row[17], row[18], row[19] = previous, asked, mask, estimate, count
                rows += 1
            previous = math.nan if closed_flags & (GAP | BAD | NOT_AUTO) else delta_y
            start = t[k]
            n, met = 0, 0
            delta_t = integral = e_max = 0.0
            sp_low = sp_high = sp_start = w
            slope_start, op_start = slope, op_now
        if broken != 0:
            met |= flag | broken
            n += 1
            if good:
                delta_t = integral = 0.0
                e_max = abs(e)
                sp_low = sp_high = sp_start = w
                slope_start, op_start = 0.0, op_now
                broken = 0
            continue
        size = abs(e)
        n += 1
        delta_t += h
        integral += size * h
        if size > e_max:
            e_max = size
        if w < sp_low:
            sp_low = w
        if w > sp_high:
            sp_high = w
        met |= flag
    return rows, estimate, count
