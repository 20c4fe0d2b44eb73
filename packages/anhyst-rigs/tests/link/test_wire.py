"""Test that frames are decoded without loss, and that damage is detected."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst_rigs.link.frames import BlockDataRequest, DemandRequest, HeartbeatRequest
from anhyst_rigs.link.wire import Receiver, cobs_decode, cobs_encode, encode

BODIES = st.binary(max_size=253)


@given(BODIES)
def test_stuffed_bytes_have_no_zero_and_come_back(body: bytes) -> None:
    stuffed = cobs_encode(body)
    assert 0 not in stuffed
    assert len(stuffed) == len(body) + 1
    assert cobs_decode(stuffed) == body


def test_stuffing_follows_the_published_examples() -> None:
    assert cobs_encode(b"\x00") == b"\x01\x01"
    assert cobs_encode(b"\x11\x22\x00\x33") == b"\x03\x11\x22\x02\x33"
    assert cobs_encode(b"\x11\x00\x00\x00") == b"\x02\x11\x01\x01\x01"


@settings(max_examples=50)
@given(
    garbage=st.binary(max_size=600),
    cuts=st.lists(st.integers(0, 700), max_size=6),
    force=st.integers(-(1 << 31), (1 << 31) - 1),
)
def test_a_frame_after_a_zero_is_found_after_any_garbage(garbage: bytes, cuts: list[int], force: int) -> None:
    stream = garbage + b"\0" + encode(DemandRequest(force), 7)
    receiver = Receiver()
    places = [0, *sorted(cuts), len(stream)]
    found = [frame for begin, end in pairwise(places) for frame in receiver.feed(stream[begin:end])]
    assert found[-1].sequence == 7
    assert DemandRequest.unpack(found[-1].payload).force == force


def test_every_single_flipped_bit_is_found() -> None:
    wire = encode(BlockDataRequest(3, (0, 1, -1, 256)), 9)
    for bit in range(8 * (len(wire) - 1)):
        spoilt = bytearray(wire)
        spoilt[bit // 8] ^= 1 << bit % 8
        receiver = Receiver()
        assert receiver.feed(bytes(spoilt)) == []
        assert receiver.bad_count > 0


def test_the_longest_frame_is_254_bytes() -> None:
    assert len(encode(BlockDataRequest(0, tuple(range(119))), 0)) == 254
    assert len(encode(HeartbeatRequest(), 0)) == 14
