import json
from itertools import chain, islice, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from langwm_data.shards.stream import SampleStream

SEEDS = st.none() | st.integers(0, 100)


def stream(count, *, seed=None, part=0, num_parts=1):
    return SampleStream(range(count), shuffle_seed=seed, part=part, num_parts=num_parts)


@given(count=st.integers(0, 50), num_parts=st.integers(1, 7), seed=SEEDS)
def test_parts_are_disjoint_and_complete_in_every_epoch(count, num_parts, seed):
    parts = [stream(count, seed=seed, part=p, num_parts=num_parts) for p in range(num_parts)]
    for _ in range(2):
        lists = [list(part) for part in parts]
        assert sorted(chain.from_iterable(lists)) == list(range(count))
        assert max(map(len, lists)) - min(map(len, lists)) <= 1


def through_json(state):
    return json.loads(json.dumps(state))


@given(
    data=st.data(), count=st.integers(1, 40), ranks=st.integers(1, 3), workers=st.integers(1, 3), seed=SEEDS
)
def test_stopping_readers_anywhere_loses_and_repeats_no_sample(data, count, ranks, workers, seed):
    """Each worker of each rank stops where it happens to stand, and another process goes on."""
    num_parts, seen = ranks * workers, []
    for rank, worker in product(range(ranks), range(workers)):
        division = {"seed": seed, "part": rank * workers + worker, "num_parts": num_parts}
        first, second = stream(count, **division), stream(count, **division)
        stop = data.draw(st.integers(0, len(first)))
        seen += islice(first, stop)
        second.load_state_dict(through_json(first.state_dict()))
        seen += second
    assert sorted(seen) == list(range(count))


@given(count=st.integers(1, 30), seed=SEEDS, stop=st.integers(0, 70))
def test_a_restored_stream_goes_on_where_the_other_stood_in_this_and_later_epochs(count, seed, stop):
    def numbers(source):
        while True:
            yield from source

    first, second = stream(count, seed=seed), stream(count, seed=seed)
    walk = numbers(first)
    for _ in range(stop):
        next(walk)
    second.load_state_dict(through_json(first.state_dict()))
    rest, restored = numbers(first), numbers(second)
    assert [next(rest) for _ in range(2 * count)] == [next(restored) for _ in range(2 * count)]


def test_order_is_that_of_the_index_unless_shuffled():
    assert list(stream(10)) == list(range(10))
    shuffled = stream(10, seed=0)
    first, second = list(shuffled), list(shuffled)
    assert first != second != list(range(10))
    assert list(stream(10, seed=0)) == first


def test_a_wrong_part_or_position_are_refused():
    with pytest.raises(ValueError, match="part is 2; allowed with num_parts=2: 0 to 1"):
        stream(5, part=2, num_parts=2)
    state = stream(5).state_dict()
    with pytest.raises(ValueError, match="position 9 in epoch 0 does not exist; an epoch has 5 samples"):
        stream(5).load_state_dict(state | {"position": 9})


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (stream(6), "the saved stream has num_samples 6; this one has 5"),
        (stream(5, seed=3), "the saved stream has shuffle_seed 3; this one has None"),
        (stream(5, num_parts=2), "the saved stream has num_parts 2; this one has 1"),
    ],
)
def test_the_state_of_a_stream_divided_otherwise_is_refused(other, message):
    with pytest.raises(ValueError, match=message):
        stream(5).load_state_dict(other.state_dict())
