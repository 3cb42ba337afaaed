"""The paper's statements judged on pooled boxes: every rule on boxes made by hand."""

import math
from dataclasses import replace

import pytest
from test_findings import DEVICES, study

from experiments.analysis.box_findings import (
    MEASURES,
    PooledBox,
    box_findings,
    box_findings_of,
    pooled_box,
    pooled_boxes,
)
from experiments.analysis.findings import CANNOT_TELL, FAILS, HOLDS

ERROR, FORCE, ROUGHNESS = MEASURES
#: As the paper's text has them: median and length of the box, of path error, force and roughness.
PAPER = {
    1: ((8.0, 2.0), (2.0, 0.4), (10.0, 2.0)),
    2: ((3.0, 1.2), (6.0, 1.0), (60.0, 9.0)),
    3: ((3.6, 0.5), (4.6, 1.0), (45.0, 9.0)),
    4: ((2.9, 1.3), (4.0, 0.5), (30.0, 5.0)),
    5: ((3.8, 1.1), (2.2, 0.4), (11.0, 2.0)),
}


def made(changes=(), wider=1.5):
    """Boxes on both devices; changes: (measure, controller, median, length[, devices]) in place of the paper's."""
    boxes = {}
    for device in DEVICES:
        for controller, of_it in PAPER.items():
            for measure, (median, length) in zip(MEASURES, of_it, strict=True):
                length *= wider if (device, controller, measure) == ("four-brake", 1, ERROR) else 1.0
                boxes[measure, device, controller] = around(median, length)
    for measure, controller, median, length, *devices in changes:
        for device in devices or DEVICES:
            boxes[measure, device, controller] = around(median, length)
    return boxes


def around(median, length):
    return PooledBox(median - 0.5 * length, median, median + 0.5 * length)


def judged(boxes, bands=1.0):
    return {one.statement.number: one for one in box_findings(boxes, DEVICES, bands)}


def test_all_eleven_hold_in_boxes_as_the_papers_text_describes_them():
    found = judged(made())
    assert {one.verdict for one in found.values()} == {HOLDS} and len(found) == 11
    assert all(one.margin >= 0.0 for one in found.values())


#: statement, changes just inside the rule, changes just outside it, and the margin of the latter in units of U
BOUNDS = {
    "1: median less than the uncontrolled quartile, and mine beyond its own": (
        1, [(ERROR, 2, 3.0, 9.9)], [(ERROR, 2, 3.0, 10.4)], -0.2 / 8.0,
    ),
    "1: outside the uncontrolled box": (1, [(ERROR, 3, 6.49, 0.5)], [(ERROR, 3, 6.6, 0.5)], -0.1 / 8.0),
    "2: at either gain": (2, [(ERROR, 5, 6.4, 1.1)], [(ERROR, 5, 7.2, 1.1)], -0.7 / 8.0),
    "3: box shorter than every other's": (3, [(ERROR, 3, 3.6, 0.64)], [(ERROR, 3, 3.6, 0.8)], -0.05),
    "4: smoother": (4, [(ROUGHNESS, 3, 58.4, 9.0)], [(ROUGHNESS, 3, 59.0, 9.0)], -0.05),
    "5: lighter": (5, [(FORCE, 3, 5.69, 1.0)], [(FORCE, 3, 5.8, 1.0)], -0.05),
    "6: little accuracy": (6, [(ERROR, 3, 4.19, 0.5)], [(ERROR, 3, 4.6, 0.5)], -0.05),
    "7: little accuracy, either way": (7, [(ERROR, 5, 4.09, 1.1)], [(ERROR, 5, 1.3, 1.1)], -0.05),
    "7: lighter, boxes apart": (7, [(FORCE, 5, 3.69, 0.5)], [(FORCE, 5, 3.85, 0.5)], -0.075),
    "8: similar force": (8, [(FORCE, 5, 2.59, 0.4)], [(FORCE, 5, 2.7, 0.4)], -0.05),
    "8: similar smoothness": (8, [(ROUGHNESS, 5, 7.1, 2.0)], [(ROUGHNESS, 5, 6.5, 2.0)], -0.05),
    "9: mean of the two": (9, [(FORCE, 4, 7.79, 0.5)], [(FORCE, 4, 8.1, 0.5)], -0.075),
    "10: no gain": (10, [(ERROR, 4, -1.8, 1.3, "four-brake")], [(ERROR, 4, -2.3, 1.3, "four-brake")], -0.0125),
    "10: wider": (10, [(ERROR, 1, 8.0, 2.31, "four-brake")], [(ERROR, 1, 8.0, 2.2, "four-brake")], -0.05),
    "11: similar improvement": (11, [(ERROR, 4, 1.5, 1.3)], [(ERROR, 4, 1.0, 1.3)], -0.05),
}  # fmt: skip


@pytest.mark.parametrize("number, inside, outside, margin", BOUNDS.values(), ids=BOUNDS)
def test_each_rule_has_its_bound(number, inside, outside, margin):
    assert judged(made(inside))[number].verdict == HOLDS
    found = judged(made(outside))[number]
    assert found.verdict == FAILS and found.margin == pytest.approx(margin, abs=1e-9)


@pytest.mark.parametrize("number, inside, outside, margin", BOUNDS.values(), ids=BOUNDS)
def test_no_rule_knows_a_unit(number, inside, outside, margin):
    """Errors a thousand times smaller, forces seven times larger: the same margins."""
    for changes in (inside, outside):
        boxes = made(changes)
        factor = {ERROR: 1e-3, FORCE: 7.0, ROUGHNESS: 1.0}
        scaled = {cell: PooledBox(*(factor[cell[0]] * q for q in box)) for cell, box in boxes.items()}
        before, after = ([one.margin for one in judged(some).values()] for some in (boxes, scaled))
        assert after == pytest.approx(before, abs=1e-9)


def test_a_statement_must_hold_on_both_devices():
    boxes = made([(FORCE, 3, 6.0, 1.0, "four-brake")])
    assert judged(boxes)[5].verdict == FAILS and "four-brake" in judged(boxes)[5].sentence


def test_wider_bands_ask_more_of_a_difference_and_less_of_a_likeness():
    lighter, costlier = made([(FORCE, 3, 5.6, 1.0)]), made([(ERROR, 3, 4.4, 0.5)])
    assert [judged(lighter, bands)[5].verdict for bands in (0.5, 1.0, 2.0)] == [HOLDS, HOLDS, FAILS]
    assert [judged(costlier, bands)[6].verdict for bands in (0.5, 1.0, 2.0)] == [FAILS, FAILS, HOLDS]


def test_a_missing_box_leaves_its_statements_open_and_no_others():
    boxes = made()
    del boxes[FORCE, "four-brake", 3]
    found = judged(boxes)
    assert {number for number, one in found.items() if one.verdict == CANNOT_TELL} == {5, 9, 10}
    assert math.isnan(found[5].margin) and "'SDOF with gap' on four-brake" in found[5].sentence
    one_device = box_findings({cell: box for cell, box in made().items() if cell[1] == "three-brake"}, DEVICES[:1])
    assert [one.verdict for one in one_device] == [HOLDS] * 9 + [CANNOT_TELL, HOLDS]


def test_boxes_pool_the_trials_of_everyone_that_reached_the_end():
    rows = study(people=3)
    boxes = {cell: box for cell, box in pooled_boxes(rows).items() if cell[1:] == ("three-brake", 2)}
    errors = sorted(r.path_error_m for r in rows if (r.configuration, r.controller) == ("three-brake", 2))
    assert boxes[ERROR, "three-brake", 2] == pooled_box(errors) and len(errors) == 18
    late = [replace(r, status="timeout") if r.controller == 3 and r.repetition == 1 else r for r in rows]
    found = {one.statement.number: one for one in box_findings_of(late)}
    assert found[5].verdict == CANNOT_TELL and "too few of its trials reached the end" in found[5].sentence
