"""Packets and their ring: what the machine does is the plan, or a hold on its path, whatever the producer does."""

from __future__ import annotations

import mmap
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from cases import mill

from interp.packets import Packet, PacketStream, PlanPackets, StreamStatus
from interp.plan_file import plan_bytes
from interp.step import PlanStep
from planner import check, load_curve, plan_feedrate
from planner.errors import InputError
from planner.samples import Samples

RESERVE = 0.1
SLOTS = 3


@pytest.fixture(scope="module")
def planned():
    """Curve, limits and plan file of a plan with a reserve."""
    curve, limits = load_curve("butterfly-nurbs"), mill(dim=2)
    profile = plan_feedrate(curve, limits.with_reserve(RESERVE))
    profile = replace(profile, origin=replace(profile.origin, override_reserve=RESERVE))
    return curve, limits, plan_bytes(profile, limits)


@pytest.fixture(scope="module")
def packets(planned):
    return list(PlanPackets(planned[2], seconds=0.5))


def stream_of(packets, **changes):
    return PacketStream(1e-3, 2, max(len(packet.content) for packet in packets), **({"slots": SLOTS} | changes))


def samples_of(positions, u):
    positions, u = np.array(positions), np.array(u)
    return Samples(1e-3, 1e-3 * np.arange(len(u)), u, positions, axes=("X", "Y"))


def worst(samples, limits):
    """Largest velocity, acceleration and jerk as shares of the limits, the machine standing before and after."""
    q = samples.position
    q = np.concatenate([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])
    each = enumerate((limits.velocity, limits.acceleration, limits.jerk), 1)
    return max(float((np.abs(np.diff(q, n, axis=0)) / most).max()) / 1e-3**n for n, most in each)


def test_packets_that_come_in_time_are_the_plan(planned, packets):
    stream, reference = stream_of(packets), PlanStep(planned[2])
    expected, _ = reference.run(10**6)
    found = []
    while True:
        if stream.put_count < len(packets):
            stream.put(packets[stream.put_count])
        status = stream.step()
        found.append(stream.position.copy())
        if status == StreamStatus.DONE:
            break
        assert status == StreamStatus.RUNNING
    assert len(packets) == 10
    assert np.abs(np.array(found) - expected).max() < 1e-12


class Producer:
    """Puts packets after random delays; at random it dies, and what it was about to put is lost."""

    def __init__(self, packets, rng, delay):
        self.packets, self.rng, self.delay = packets, rng, delay
        self.restarts, self.ready_at, self.carried = 0, 0, None

    def period(self, k, stream):
        if self.rng.random() < 5e-4:
            self.restarts += 1
            self.carried, self.ready_at = None, k + int(self.rng.exponential(2.0 * self.delay))
        if k < self.ready_at or stream.put_count == len(self.packets):
            return
        if self.carried is None:
            self.carried, self.ready_at = stream.put_count, k + int(self.rng.exponential(self.delay))
        elif stream.put(self.packets[self.carried]):
            self.carried = None


def streamed(planned, packets, seed, delay, knobs):
    """Run a stream to its end; samples, statuses and the producer."""
    rng = np.random.default_rng(seed)
    producer, stream = Producer(packets, rng, delay), stream_of(packets)
    start = PlanStep(planned[2]).position.copy()
    positions, u, statuses = [start], [0.0], []
    override, hold = 1.0, False
    for k in range(200_000):
        producer.period(k, stream)
        if knobs and rng.random() < 0.003:
            asked = rng.choice([0.0, 0.3, rng.random()]), rng.random() < 0.3
            override, hold = (1.0, False) if rng.random() < 0.5 else asked
        statuses.append(stream.step(override, hold))
        if statuses[-1] != StreamStatus.EMPTY:
            positions.append(stream.position.copy())
            u.append(stream.u)
        if statuses[-1] == StreamStatus.DONE:
            return samples_of(positions, u), statuses, producer
    raise AssertionError("the stream did not come to its end")


def require_sound(planned, samples):
    curve, limits, content = planned
    report = check(curve, limits, samples)
    assert not report.violations
    assert worst(samples, limits) <= 1.0
    whole = PlanStep(content)
    whole.run(10**6)
    assert np.array_equal(samples.position[-1], whole.position)


@pytest.mark.parametrize("seed", range(6))
def test_a_producer_that_is_late_dies_and_comes_back_costs_time_and_no_limit(planned, packets, seed):
    samples, statuses, producer = streamed(planned, packets, seed, delay=600.0, knobs=seed % 2 == 1)
    assert StreamStatus.LATE in statuses
    assert producer.restarts >= 1
    assert len(samples) > 5456  # it was stopped, and went on
    require_sound(planned, samples)


@pytest.mark.slow
def test_many_producers(planned, packets):
    late = 0
    for seed in range(100, 200):
        samples, statuses, _ = streamed(planned, packets, seed, delay=50.0 * (1 + seed % 30), knobs=seed % 2 == 1)
        late += StreamStatus.LATE in statuses
        require_sound(planned, samples)
    assert late >= 50


def test_the_tail_of_every_packet_is_a_stop_that_the_check_accepts(planned, packets):
    """A producer that never comes again, after each of the packets."""
    curve, limits, _ = planned
    for count in range(1, len(packets)):
        stream = stream_of(packets, slots=len(packets))
        for packet in packets[:count]:
            assert stream.put(packet)
        positions, u = [PlanStep(planned[2]).position.copy()], [0.0]
        while len(u) < 20_000 and (len(u) < 10 or stream.rate > 0.0):
            status = stream.step()
            positions.append(stream.position.copy())
            u.append(stream.u)
        assert status == StreamStatus.LATE
        samples = samples_of(positions, u)
        assert [row.limit for row in check(curve, limits, samples).violations] == ["path end"]  # it stops before that
        assert worst(samples, limits) <= 1.0
        end = PlanStep(packets[count - 1].content)
        assert stream.time < packets[count - 1].first * 1e-3 + end.duration  # within what the packet holds


def test_a_tail_is_long_enough_from_any_state_of_the_rate(planned):
    """Whatever was asked for before, a stop takes no more plan time than is said."""
    step, rng, longest = PlanStep(planned[2]), np.random.default_rng(3), 0.0
    for trial in range(400):
        step.seek(sample=int(rng.integers(500, 2500)), rate=1.0 if trial % 4 == 0 else float(rng.random()))
        for _ in range(int(rng.integers(0, 5))):
            step.run(int(rng.integers(1, 300)), override=rng.choice([0.0, 1.0, rng.random()]))
        before = step.time
        step.run(1500, hold=True)
        assert step.rate == 0.0
        longest = max(longest, step.time - before)
    assert 0.3 * step.stop_room < longest <= step.stop_room


def test_what_would_be_a_jump_or_no_stop_is_refused(planned, packets):
    stream = stream_of(packets, slots=len(packets))
    first, second, third = packets[:3]
    with pytest.raises(InputError, match="does not begin where"):
        stream.put(second)
    with pytest.raises(InputError, match="tail is too short"):
        stream.put(replace(first, next=first.next + 40))
    assert stream.put_count == 0
    assert stream.put(first)
    with pytest.raises(InputError, match="does not begin where"):
        stream.put(third)
    with pytest.raises(InputError, match="first samples are not those"):
        stream.put(replace(third, first=second.first, next=second.next))
    with pytest.raises(InputError, match="no plan file"):
        stream.put(replace(second, content=second.content[:-1] + b"?"))
    assert stream.put(second)
    assert stream.put_count == 2


def test_a_full_ring_is_no_error_and_a_packet_beyond_a_slot_is_one(packets):
    stream = stream_of(packets, slots=2)
    assert [stream.put(packet) for packet in packets[:3]] == [True, True, False]
    small = PacketStream(1e-3, 2, len(packets[0].content) - 64, slots=2)
    with pytest.raises(InputError, match="larger than a slot"):
        small.put(packets[0])


def test_a_plan_without_a_reserve_has_no_packets():
    curve, limits = load_curve("circle"), mill(dim=2)
    with pytest.raises(InputError, match="without a reserve"):
        PlanPackets(plan_bytes(plan_feedrate(curve, limits), limits))


def test_wrong_sizes_and_periods_are_refused(planned):
    for period, slots in ((0.0, 3), (np.inf, 3), (np.nan, 3), (1e-3, 1)):
        with pytest.raises(InputError, match=r"period = .* slots = "):
            PacketStream(period, 2, 1000, slots=slots)
    with pytest.raises(InputError, match="seconds = "):
        PlanPackets(planned[2], seconds=1e-3)


def test_before_the_first_packet_nothing_is_written(packets):
    stream = stream_of(packets)
    assert stream.step() == StreamStatus.EMPTY
    assert not stream.position.any()


def test_packets_know_the_lines_of_the_program(planned):
    curve, limits, _ = planned
    profile = plan_feedrate(curve, limits.with_reserve(RESERVE))
    lines = [(0.0, 10), (0.4, 20), (1.7, 30), (3.0, 40)]
    governor = PlanPackets(planned[2]).plan.governor
    content = plan_bytes(profile, limits, lines=lines, governor=governor)
    for packet in PlanPackets(content, seconds=0.5):
        whole, part = PlanStep(content), PlanStep(packet.content)
        for sample in (0, 250, 499):
            whole.seek(sample=packet.first + sample, rate=1.0)
            part.seek(sample=sample, rate=1.0)
            assert part.line == whole.line


def _produce(memory, packets, seed):
    """A planner's process: puts what is next, each after a delay."""
    rng = np.random.default_rng(seed)
    while PacketStream.attach(memory).put_count < len(packets):
        time.sleep(rng.exponential(0.2))
        PacketStream.attach(memory).put(packets[PacketStream.attach(memory).put_count])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_process_that_is_killed_and_restarted(planned, packets):
    """A producer of another process, by SIGKILL at any place; the consumer runs five times faster than the clock."""
    size = PacketStream.memory_size(max(len(packet.content) for packet in packets), SLOTS)
    shared = mmap.mmap(-1, size)
    memory = np.frombuffer(shared, dtype=np.uint8)
    stream = stream_of(packets, memory=memory)
    rng = np.random.default_rng(8)
    positions, u, kills, child = [PlanStep(planned[2]).position.copy()], [0.0], 0, 0
    statuses = set()
    until = time.monotonic() + 60.0
    try:
        while time.monotonic() < until:
            if not child:
                child = os.fork()
                if not child:
                    try:
                        _produce(memory, packets, kills)
                    finally:
                        os._exit(0)
                dies = time.monotonic() + rng.exponential(0.5)
            elif time.monotonic() > dies and stream.put_count < len(packets):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                child, kills = 0, kills + 1
            for _ in range(5):
                status = stream.step()
                statuses.add(status)
                if status != StreamStatus.EMPTY:
                    positions.append(stream.position.copy())
                    u.append(stream.u)
            if status == StreamStatus.DONE:
                break
            time.sleep(1e-3)
    finally:
        if child:
            os.waitpid(child, 0)
    assert status == StreamStatus.DONE
    assert kills >= 1
    assert StreamStatus.LATE in statuses
    samples = samples_of(positions, u)
    require_sound(planned, samples)


def test_the_packet_of_a_number_is_always_the_same(planned, packets):
    again = PlanPackets(planned[2], seconds=0.5)
    assert isinstance(again[3], Packet)
    assert again[3] == packets[3]
