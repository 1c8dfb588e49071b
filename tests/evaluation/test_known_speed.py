import numpy as np
from scipy.special import log_softmax

from shoot.evaluation.known_speed import tell_speed


def _case(seed=0):
    generator = np.random.default_rng(seed)
    return (
        log_softmax(generator.normal(size=(6, 9)), axis=1),
        log_softmax(generator.normal(size=(6, 9)), axis=1),
        log_softmax(generator.normal(size=9)),
    )


def test_by_hand():
    # Odds 1 : 3 of the planner; the speed makes the first four times as likely as the prior has it.
    told = tell_speed(np.log([[0.25, 0.75]]), np.log([[0.8, 0.2]]), np.log([0.5, 0.5]))
    np.testing.assert_allclose(np.exp(told), [[4 / 7, 3 / 7]])


def test_a_speed_that_says_no_more_than_the_prior_changes_nothing():
    log_prob, _, log_prior = _case()
    told = tell_speed(log_prob, np.tile(log_prior, (6, 1)), log_prior)
    np.testing.assert_allclose(told, log_prob)


def test_a_planner_that_says_the_prior_is_told_what_the_speed_prior_says():
    _, log_speed_prior, log_prior = _case()
    told = tell_speed(np.tile(log_prior, (6, 1)), log_speed_prior, log_prior)
    np.testing.assert_allclose(told, log_speed_prior)


def test_is_bayes_rule_where_image_and_speed_are_independent_given_the_template():
    generator = np.random.default_rng(1)
    prior = generator.dirichlet(np.ones(5))
    image_given, speed_given = (
        generator.dirichlet(np.ones(4), 5),
        generator.dirichlet(np.ones(3), 5),
    )
    image, speed = np.divmod(np.arange(12), 3)
    by_image, by_speed = prior * image_given.T, prior * speed_given.T  # joint, not yet normalised
    both = prior * image_given.T[image] * speed_given.T[speed]
    told = tell_speed(
        np.log(by_image / by_image.sum(1, keepdims=True))[image],
        np.log(by_speed / by_speed.sum(1, keepdims=True))[speed],
        np.log(prior),
    )
    np.testing.assert_allclose(np.exp(told), both / both.sum(1, keepdims=True))


def test_inputs_are_left_alone():
    case = _case()
    copies = [array.copy() for array in case]
    tell_speed(*case)
    for array, copy in zip(case, copies, strict=True):
        np.testing.assert_array_equal(array, copy)
