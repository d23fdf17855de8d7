"""Loss counting from sequence numbers of unlabelled, interleaved publishers."""

import random

from hypothesis import given
from hypothesis import strategies as st

from waam_record.loss import LossCounter


def test_one_publisher():
    counter = LossCounter()
    for n in (5, 6, 7, 10, 11, 15):
        counter.seen(n)
    assert (counter.received, counter.lost) == (6, 5)


def test_restarted_publisher_is_no_loss():
    counter = LossCounter()
    for n in (1, 2, 3, 1, 2, 3, 4):
        counter.seen(n)
    assert counter.lost == 0


@given(seed=st.integers(0, 10_000), publishers=st.integers(1, 8), spread=st.integers(1, 60))
def test_nothing_lost_is_never_called_a_loss(seed, publishers, spread):
    """Any interleaving, any beginnings, nobody need have been heard before."""
    rng = random.Random(seed)
    numbers = [rng.randrange(1, spread + 1) for _ in range(publishers)]
    counter = LossCounter()
    counter.publishers = publishers
    for _ in range(300):
        who = rng.randrange(publishers)
        counter.seen(numbers[who])
        numbers[who] += 1
    assert (counter.lost, counter.received) == (0, 300)


def lose(numbers, share, rng, order):
    """Runs publishers that continue after `numbers`; every one is heard again at the end. Returns counter and loss."""
    counter = LossCounter()
    counter.publishers = len(numbers)
    for n in numbers:
        counter.seen(n)
    lost = 0
    for who in order:
        numbers[who] += 1
        if rng.random() < share:
            lost += 1
        else:
            counter.seen(numbers[who])
    for who in range(len(numbers)):
        numbers[who] += 1
        counter.seen(numbers[who])
    return counter, lost


@given(seed=st.integers(0, 10_000), publishers=st.integers(1, 6), share=st.floats(0, 0.5))
def test_exact_for_one_publisher_and_for_numbers_far_apart(seed, publishers, share):
    rng = random.Random(seed)
    numbers = [1 + 10_000 * k for k in range(publishers)]
    order = [rng.randrange(publishers) for _ in range(300)]
    counter, lost = lose(numbers, share, rng, order)
    assert counter.lost == lost


@given(seed=st.integers(0, 10_000), publishers=st.integers(2, 10))
def test_exact_for_rare_losses_of_publishers_in_step(seed, publishers):
    """The heartbeats of a graph: all publish at one rate from one beginning."""
    rng = random.Random(seed)
    order = [who for _ in range(40) for who in rng.sample(range(publishers), publishers)]
    counter, lost = lose([1] * publishers, 0.01, rng, order)
    assert counter.lost == lost
