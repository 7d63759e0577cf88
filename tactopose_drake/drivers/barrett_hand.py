"""The driver of Barrett's BH8-280 hand: joint angles, tactile arrays and fingertip torques over CAN.

Not tested on hardware: written from what public drivers agree on (`barrett_protocol.py`). The duration of a tare and
the bit of ROLE that marks a tactile array are assumptions.
"""

import collections
from collections.abc import Generator, Sequence

import can
import numpy as np

from tactopose_drake.core.validation import check_count, finite_array, positive_number, whole_number
from tactopose_drake.drivers import barrett_protocol as protocol
from tactopose_drake.drivers.barrett_cycle import FINGERS, Answer, EncoderState, HandCycle, HandSample
from tactopose_drake.drivers.barrett_joints import STRAIN_POLYNOMIAL
from tactopose_drake.drivers.barrett_protocol import HAND_GROUP, Property, Puck, PuckStatus, ReplyGroup, TactileMode
from tactopose_drake.drivers.barrett_questions import Answers, get_frame, set_frame
from tactopose_drake.drivers.device import Conversation, Device, Exchange, Pause
from tactopose_drake.drivers.device_bus import DeviceBus
from tactopose_drake.errors import DeviceError, DeviceTimeoutError, InvalidInputError

_NODES = range(1, 32)  # identifiers of pucks, the hand's and others (an arm's)
_SPACING = 0.001  # between two requests of an enumeration, s [L]
_WAKE_SPACING, _WAKE_TIME = 0.010, 1.0  # s; frames sent while a puck wakes up can take it off the bus [L]
_SETTLE_TIME = 0.05  # wait for pending replies, such as the reading that follows a new tactile mode, s
_TARE_TIME = 0.5  # s, assumed
_ABSENT_AFTER = 3  # rounds without an answer, after which a round does not wait for it
_SEARCH_PERIOD = 1.0  # between two searches for pucks that are absent, s


class BarrettHand(Device[HandSample]):
    """A BH8-280 hand: its pucks are found and woken, then polled in rounds. Only `initialize` moves it.

    Each round requests position, fingertip torque and pressures from all pucks, and gives one sample of the replies. A
    puck that does not reply delays a few rounds by one timeout each; later rounds do not wait for it, but the status
    still names it. It is searched for once a second, and set up again when it is back. Replies have no sequence number:
    those of a single puck that come more than a round late are taken for the next round's.

    A puck that must be woken again has restarted, so that the zero of its positions is unknown until its joint is
    initialized.

    Attributes:
        pucks: status of every puck that answered the last enumeration, by its number.
    """

    def __init__(
        self,
        bus: DeviceBus,
        *,
        mode: TactileMode = TactileMode.FULL,
        period: float = 0.025,
        timeout: float = 0.1,
        strain_polynomials: Sequence[Sequence[float]] = (STRAIN_POLYNOMIAL,) * 3,
        name: str = "Barrett hand",
    ) -> None:
        """Prepares the driver, which uses the bus while it is entered as a context manager.

        Args:
            bus: the bus that the hand is on.
            mode: mode of the tactile arrays, `FULL` or `TOP`.
            period: time between two rounds, s; the arrays reach about 40 rounds per second.
            timeout: maximum wait for the answers of a round, s.
            strain_polynomials: calibration of the strain gauges of F1 to F3: polynomials from reading to torque, N m,
                highest power first.
            name: the hand's name in messages.

        Raises:
            InvalidInputError: if an argument is out of its range.
        """
        if mode not in (TactileMode.FULL, TactileMode.TOP):
            raise InvalidInputError(f"mode must be FULL or TOP, not {TactileMode(mode).name}.")
        if len(strain_polynomials) != len(FINGERS):
            raise InvalidInputError(
                f"strain_polynomials must be {len(FINGERS)} polynomials, not {len(strain_polynomials)}."
            )
        for finger, polynomial in zip(FINGERS, strain_polynomials, strict=True):
            what = f"strain_polynomials[{finger.name}]"
            check_count(what, len(finite_array(what, polynomial, (None,))), "coefficients")
        replies = {protocol.reply_identifier(puck, group) for puck in _NODES for group in ReplyGroup}
        super().__init__(bus, name, requests=frozenset({*_NODES, HAND_GROUP}), replies=frozenset(replies))
        self._mode, self._polynomials = mode, strain_polynomials
        self._period, self._timeout = positive_number("period", period), positive_number("timeout", timeout)
        self._commands: collections.deque[Conversation] = collections.deque()
        self._bare: set[Puck] = set()  # pucks without a tactile array
        self._sampling = False
        self._joint_encoders = EncoderState()
        self._known: set[Puck] = set()  # pucks that have been awake before
        self.pucks: dict[int, PuckStatus] = {}

    def tare(self, timeout: float = 2.0) -> None:
        """Makes the present pressures the zero in the hand itself, after the present round. It takes half a second.

        Unread samples from before the tare are dropped.

        Args:
            timeout: maximum wait for the tare, and then for the first sample, s.

        Raises:
            InvalidInputError: if `timeout` is not a finite number > 0.
            DeviceError: if the hand is not being sampled, in which case nothing is sent; or an array does not answer or
                has failed.
            DeviceTimeoutError: if the hand does not answer in time.
        """
        timeout = positive_number("timeout", timeout)  # before anything is sent
        arrays = [puck for puck in Puck if puck not in self._bare]
        outcome: list[dict[int, int]] = []
        self._command(self._tare(arrays, outcome))
        identities = self.bus.wait_for(lambda: outcome[0] if outcome else None, timeout)
        if identities is None:
            raise DeviceTimeoutError(f"{self.name} was not tared within {timeout:g} s; its state: {self.status}.")
        self._unread.clear()
        pressures = self.read(timeout).pressures
        working = {puck for puck, identity in identities.items() if identity != protocol.TACTILE_FAILED}
        working -= {puck for puck in Puck if np.isnan(pressures[puck - Puck.F1]).all()}
        if lost := [puck.name for puck in arrays if puck not in working]:
            raise DeviceError(f"{self.name} cannot be tared; silent, or failed, are the arrays of {', '.join(lost)}.")

    def initialize(self, puck: Puck) -> None:
        """MOVES a joint to its stops, which sets the zero of its positions, after the present round.

        Initialize the fingers first, and the spread when they are open; otherwise, they may collide. The hand does not
        report the end of the motion. Until the joint is at its stops, its positions still have their previous zero;
        after a restart, do not use them before then.

        Args:
            puck: puck of the joint.

        Raises:
            InvalidInputError: if there is no such puck.
            DeviceError: if the hand is not being sampled, in which case nothing is sent.
        """
        self._command(self._initialize(Puck(whole_number("puck", puck, least=Puck.F1, most=Puck.SPREAD))))

    def follow(self, request: can.Message, time: float) -> None:
        """Takes a recorded request; one that initializes a joint sets the zero of its positions."""
        super().follow(request, time)
        self._note(request)

    def _note(self, request: can.Message) -> None:
        """Notes a command that sets the zero of a joint's positions."""
        if request.data == protocol.encode_set(Property.COMMAND, protocol.INITIALIZE):
            self._joint_encoders.restarted.discard(request.arbitration_id)

    def _command(self, command: Conversation) -> None:
        # Never queued for a hand that does not answer, because it could then move unexpectedly.
        if not self._sampling:
            raise DeviceError(f"{self.name} cannot be commanded; its state: {self.status}.")
        self._commands.append(command)

    def _tare(self, arrays: list[Puck], outcome: list[dict[int, int]]) -> Conversation:
        """Tares the arrays; `outcome` receives their identities.

        A tare is not acknowledged. A puck that answers the request right before it is taken to have received it.
        """
        answers = Answers(Property.TACTILE_ID)
        questions = tuple(get_frame(puck, Property.TACTILE_ID) for puck in arrays)
        tare = set_frame(HAND_GROUP, Property.TACTILE, TactileMode.TARE)
        yield Exchange((*questions, tare), answers.ignore_end, _TARE_TIME)
        yield Exchange((set_frame(HAND_GROUP, Property.TACTILE, self._mode),), _ignore, _SETTLE_TIME)
        outcome.append(answers.values)

    def _initialize(self, puck: Puck) -> Conversation:
        command = set_frame(puck, Property.COMMAND, protocol.INITIALIZE)
        self._note(command)
        yield Exchange((command,), _ignore, 0.0)

    def _converse(self) -> Conversation:
        self._sampling = False
        self._commands.clear()
        self.pucks = yield from self._enumerate()
        asleep = [puck for puck in Puck if self.pucks.get(puck) is PuckStatus.MONITOR]
        if asleep:
            self._joint_encoders.restarted |= self._known & {*asleep}
            yield from self._wake(asleep)
            self.pucks = yield from self._enumerate()
        expected, remarks = yield from self._examine()
        self._known |= {puck for puck, _ in expected}
        yield Exchange((set_frame(HAND_GROUP, Property.TACTILE, self._mode),), _ignore, _SETTLE_TIME)
        try:
            self._sampling = True
            yield from self._sample(expected, remarks)
        finally:
            self._sampling = False

    def _enumerate(self) -> Generator[Exchange | Pause, bool, dict[int, PuckStatus]]:
        answers = Answers(Property.STATUS)
        for node in _NODES:
            yield Exchange((get_frame(node, Property.STATUS),), answers.ignore_end, _SPACING)
        answers.awaited = {*Puck} - answers.values.keys()
        if answers.awaited:
            yield Exchange((), answers.collect, self._timeout)
        return {puck: PuckStatus(value) for puck, value in answers.values.items() if value in {*PuckStatus}}

    def _wake(self, asleep: list[Puck]) -> Conversation:
        self._state = "its pucks are waking up"
        self.bus.hush(self, self._now + _SETTLE_TIME + len(asleep) * _WAKE_SPACING + _WAKE_TIME)
        yield Pause(_SETTLE_TIME)  # for pending replies
        for puck in asleep:
            yield Exchange((set_frame(puck, Property.STATUS, PuckStatus.READY),), _ignore, _WAKE_SPACING)
        yield Pause(_WAKE_TIME)

    def _examine(self) -> Generator[Exchange | Pause, bool, tuple[set[Answer], list[str]]]:
        """The answers to expect from the pucks, and remarks on missing and failed parts."""
        awake = [puck for puck in Puck if self.pucks.get(puck, PuckStatus.MONITOR) is not PuckStatus.MONITOR]
        roles = yield from self._ask(awake, Property.ROLE)
        members = [puck for puck in awake if puck in roles and roles[puck] & protocol.ROLE_MASK == protocol.ROLE_HAND]
        if not members:
            raise DeviceTimeoutError("no puck of the hand answers")
        arrays = [puck for puck in members if roles[puck] & protocol.ROLE_TACTILE]
        self._bare = {*members} - {*arrays}
        identities = yield from self._ask(arrays, Property.TACTILE_ID)
        expected: set[Answer] = {(puck, "position") for puck in members}
        expected |= {(puck, "torque") for puck in members if puck in FINGERS and roles[puck] & protocol.ROLE_STRAIN}
        remarks = []
        for puck in Puck:
            if puck not in members:
                remarks.append(f"{puck.name}: absent")
            elif puck not in arrays:
                remarks.append(f"{puck.name}: has no tactile array")
            elif identities.get(puck) == protocol.TACTILE_FAILED:
                remarks.append(f"{puck.name}: its tactile array failed to start")
            else:
                expected.add((puck, "pressures"))
            if self.pucks.get(puck) is PuckStatus.ERROR:
                remarks.append(f"{puck.name}: reports an error")
        return expected, remarks

    def _ask(self, pucks: list[Puck], name: Property) -> Generator[Exchange | Pause, bool, dict[int, int]]:
        """A property of several pucks, without those that do not reply."""
        answers = Answers(name, pucks)
        if pucks:
            yield Exchange(tuple(get_frame(puck, name) for puck in pucks), answers.collect, self._timeout)
        return answers.values

    def _sample(self, expected: set[Answer], remarks: list[str]) -> Conversation:
        """Polls in rounds, until an absent puck is back."""
        questions = [get_frame(HAND_GROUP, name) for name in (Property.POSITION, Property.STRAIN, Property.TACTILE)]
        missed: collections.Counter[Answer] = collections.Counter()
        ask_at, search_at = self._now, self._now + _SEARCH_PERIOD
        while True:
            awaited = {answer for answer in expected if missed[answer] < _ABSENT_AFTER}
            if self._now >= search_at:
                search_at = self._now + _SEARCH_PERIOD
                if (yield from self._search(expected, expected - awaited)):
                    return
            cycle = HandCycle(expected, awaited, self._polynomials, self._joint_encoders)
            yield Exchange(tuple(questions), cycle.collect, self._timeout)
            self._publish(cycle.sample(self._now, remarks))
            if awaited <= cycle.missing:
                # Answers that come a round late cannot be distinguished from those of the next round.
                raise DeviceTimeoutError("no puck of the hand answers")
            for answer in expected:
                missed[answer] = missed[answer] + 1 if answer in cycle.missing else 0
            while self._commands:
                yield from self._commands.popleft()
            ask_at = max(ask_at + self._period, self._now)
            yield Pause(ask_at - self._now)

    def _search(self, expected: set[Answer], lost: set[Answer]) -> Generator[Exchange | Pause, bool, bool]:
        """Searches for the pucks that do not reply; returns whether one of them is back."""
        absent = [puck for puck in Puck if (puck, "position") in lost or (puck, "position") not in expected]
        answers = Answers(Property.STATUS, absent[:1])
        if absent:
            yield Exchange(tuple(get_frame(puck, Property.STATUS) for puck in absent), answers.collect, _SETTLE_TIME)
        # If only a puck's array does not reply, it may have lost its mode.
        mute = [puck for puck in Puck if puck not in absent and (puck, "pressures") in lost]
        for puck in mute:
            yield Exchange((set_frame(puck, Property.TACTILE, self._mode),), _ignore, _SETTLE_TIME)
        return any(puck in answers.values for puck in absent)


def _ignore(_: can.Message) -> bool:
    return False
