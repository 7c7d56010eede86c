# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Terms of an uncertainty: they add up, whatever becomes of them."""

import numpy as np
import pytest

from stereo_selfcal import Calibrator, CalibratorConfig
from stereo_selfcal.core.geometry.uncertainty import (
    TERMS,
    UncertaintyTerm,
    merge_terms,
    propagate_terms,
    total_covariance,
)
from stereo_selfcal.synth.renderer import render
from stereo_selfcal.synth.scenes import random_scene


def drawn(seed):
    root = np.random.default_rng(seed).standard_normal((3, 4))
    return root @ root.T


def test_terms_of_one_name_are_added_in_the_order_of_the_table():
    terms = [
        UncertaintyTerm("kerb", drawn(0)),
        UncertaintyTerm("noise", drawn(1)),
        UncertaintyTerm("kerb", drawn(2)),
    ]
    merged = merge_terms([*terms, UncertaintyTerm("crown", np.zeros((3, 3)))])
    assert [term.name for term in merged] == ["noise", "kerb"]
    np.testing.assert_allclose(merged[1].covariance, drawn(0) + drawn(2))
    np.testing.assert_allclose(total_covariance(merged), drawn(0) + drawn(1) + drawn(2))


def test_no_term_is_no_uncertainty():
    assert merge_terms(()) == ()
    np.testing.assert_array_equal(total_covariance(()), np.zeros((3, 3)))


def test_a_name_that_is_not_in_the_table_comes_last():
    merged = merge_terms([UncertaintyTerm("moonlight", drawn(0)), UncertaintyTerm("motion", drawn(1))])
    assert [term.name for term in merged] == ["motion", "moonlight"]


def test_the_sum_of_propagated_terms_is_the_propagated_sum():
    terms = [UncertaintyTerm("noise", drawn(0)), UncertaintyTerm("kerb", drawn(1))]
    jacobian = np.random.default_rng(5).standard_normal((3, 3))
    propagated = propagate_terms(terms, jacobian)
    np.testing.assert_allclose(
        total_covariance(propagated), jacobian @ (drawn(0) + drawn(1)) @ jacobian.T, rtol=1e-12
    )
    for term in propagated:
        np.testing.assert_array_equal(term.covariance, term.covariance.T)


@pytest.mark.parametrize(
    ("texture_amplitude", "settings", "names"),
    [
        (12.0, {}, {"noise", "rectification"}),
        (0.0, {}, {"noise"}),
        (12.0, {"texture.check": 0}, {"noise"}),
    ],
)
def test_terms_of_a_frame_add_up_to_its_covariance(texture_amplitude, settings, names):
    scene = random_scene(np.random.default_rng(3), texture_amplitude=texture_amplitude)
    calibrator = Calibrator(scene.rig, CalibratorConfig.from_mapping(settings))
    for seed in range(2):
        result = calibrator.add(*render(scene, np.random.default_rng(seed)), float(seed))
        found = {term.name for term in result.uncertainty}
        assert names <= found <= set(TERMS)
        np.testing.assert_allclose(
            total_covariance(result.uncertainty), result.covariance, atol=1e-12, rtol=0
        )
        for term in result.uncertainty:
            assert np.linalg.eigvalsh(term.covariance).min() > -1e-12
    fused = calibrator.estimate
    names_of_mount = {term.name for term in fused.uncertainty}
    assert {"noise"} < names_of_mount <= set(TERMS)
    assert len(names_of_mount & {"motion", "standing"}) == 1
    np.testing.assert_allclose(total_covariance(fused.uncertainty), fused.covariance, atol=1e-12, rtol=0)


def test_a_refused_frame_has_no_uncertainty():
    scene = random_scene(np.random.default_rng(3))
    nothing = np.full((scene.rig.height, scene.rig.width), 90, np.uint8)
    assert Calibrator(scene.rig).add(nothing, nothing).uncertainty == ()
