"""Views that contradict each other widen the error bar; views that agree do not."""

from __future__ import annotations

import numpy as np

from easyhecpp.solve.between_views import between_views


def test_views_that_contradict_each_other_widen_the_error_bar():
    rng = np.random.default_rng(0)
    information = np.stack([np.eye(7) * 100.0] * 8)
    N = information.sum(axis=0)
    agreeing = rng.normal(size=(8, 7)) * 10.0
    solution = np.linalg.solve(N, agreeing.sum(axis=0))
    usual = between_views(N, N, information, agreeing, solution)
    assert (np.diag(usual) > 0.99 / 800.0).all()
    assert (np.diag(usual) < 2.5 / 800.0).all()
    fighting = agreeing * 10.0
    solution = np.linalg.solve(N, fighting.sum(axis=0))
    assert np.trace(between_views(N, N, information, fighting, solution)) > 10.0 * np.trace(usual)


def test_noise_as_the_model_expects_it_leaves_the_error_bar_nearly_alone():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(5, 7, 7))
    information = root @ root.transpose(0, 2, 1)
    N = information.sum(axis=0)
    ratios = []
    for _ in range(200):
        vectors = np.einsum("vij,vj->vi", root, rng.normal(size=(5, 7)))
        spread = between_views(N, N, information, vectors, np.linalg.solve(N, vectors.sum(axis=0)))
        ratios.append(np.trace(N @ spread) / 7.0)
    assert 1.0 <= np.mean(ratios) < 1.3


def test_pulls_that_the_model_expects_to_be_wider_are_no_contradiction():
    """Weights that leave out a noise source: the error bar is that of the whole noise."""
    rng = np.random.default_rng(3)
    information = np.stack([np.eye(7) * 100.0] * 8)
    N = information.sum(axis=0)
    traces = []
    for _ in range(200):
        vectors = rng.normal(size=(8, 7)) * 30.0
        solution = np.linalg.solve(N, vectors.sum(axis=0))
        traces.append(np.trace(between_views(N, 9.0 * N, information, vectors, solution)))
    true = 7.0 * 9.0 / 800.0
    assert true <= np.mean(traces) < 1.4 * true
