"""The driver of Barrett's BH8-280 hand: joint angles, tactile arrays and fingertip torques over CAN.

Not tried on hardware: written from what public drivers agree on (`barrett_protocol.py`). How long a tare takes, and
which bit of ROLE says that a puck has a tactile array, are assumptions.
"""

import collections
from collections.abc import Generator, Sequence

import can
import numpy as np

from tactopose_drake.core.validation import finite_array, positive_number, whole_number
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
_WAKE_SPACING, _WAKE_TIME = 0.010, 1.0  # s; what is said while a puck wakes up can take it off the bus [L]
_SETTLE_TIME = 0.05  # for what is on its way, such as the reading that a new tactile mode brings, s
_TARE_TIME = 0.5  # s, assumed
_ABSENT_AFTER = 3  # rounds without an answer, after which it is not waited for any more
_SEARCH_PERIOD = 1.0  # between two searches for pucks that are absent, s


class BarrettHand(Device[HandSample]):
    """A BH8-280 hand: its pucks are found and woken, then asked in rounds. Only `initialize` ever moves it.

    Each round asks all pucks for position, fingertip torque and pressures, and gives one sample of what they said in
    that round. A puck that keeps silent costs one timeout for a few rounds, and is then no longer waited for; the
    status goes on naming it. It is looked for once a second, and greeted anew when it is back. Answers carry no number:
    those of a single puck that is later than a whole round would be taken for the next round's.

    A puck that has to be woken again has restarted, and counts positions from where it stood then: they are not known
    until its joint is initialized.

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
        """Prepares the driver; as a context manager it takes part in the bus's traffic.

        Args:
            bus: where the hand is.
            mode: of the tactile arrays: `FULL` or `TOP`.
            period: between two rounds, s; the arrays manage about 40 a second.
            timeout: longest wait for the answers of a round, s.
            strain_polynomials: calibration of the strain gauges of F1 to F3, highest power first, N m over reading.
            name: for messages.

        Raises:
            InvalidInputError: if an argument is out of its range.
        """
        if mode not in (TactileMode.FULL, TactileMode.TOP):
            raise InvalidInputError(f"mode: is {TactileMode(mode).name}; allowed are FULL and TOP.")
        if len(strain_polynomials) != len(FINGERS):
            raise InvalidInputError(f"strain_polynomials: are {len(strain_polynomials)}; allowed are 3.")
        for finger, polynomial in zip(FINGERS, strain_polynomials, strict=True):
            if not len(finite_array(f"strain_polynomials, {finger.name}", polynomial, (None,))):
                raise InvalidInputError(f"strain_polynomials, {finger.name}: is empty; allowed are coefficients.")
        replies = {protocol.reply_identifier(puck, group) for puck in _NODES for group in ReplyGroup}
        super().__init__(bus, name, requests=frozenset({*_NODES, HAND_GROUP}), replies=frozenset(replies))
        self._mode, self._polynomials = mode, strain_polynomials
        self._period, self._timeout = positive_number("period", period), positive_number("timeout", timeout)
        self._commands: collections.deque[Conversation] = collections.deque()
        self._bare: set[Puck] = set()  # pucks without a tactile array
        self._sampling = False
        self._joint_encoders = EncoderState()
        self._known: set[Puck] = set()  # pucks that were awake once
        self.pucks: dict[int, PuckStatus] = {}

    def tare(self, timeout: float = 2.0) -> None:
        """Makes the present pressures the zero, in the hand itself; after the present round. It takes half a second.

        Samples of before, which wait to be read, are dropped.

        Args:
            timeout: for it, and then for the first sample, s.

        Raises:
            InvalidInputError: if `timeout` is no finite number > 0.
            DeviceError: if the hand is not being sampled (nothing is sent then, nor later), or an array is silent, at
                the tare or after it, or has failed.
            DeviceTimeoutError: if the hand falls silent meanwhile.
        """
        timeout = positive_number("timeout", timeout)  # before anything is sent
        arrays = [puck for puck in Puck if puck not in self._bare]
        outcome: list[dict[int, int]] = []
        self._command(self._tare(arrays, outcome))
        identities = self.bus.wait_for(lambda: outcome[0] if outcome else None, timeout)
        if identities is None:
            state = self.status.removesuffix(".")
            raise DeviceTimeoutError(f"{self.name}: was not tared within {timeout:g} s; its state: {state}.")
        self._unread.clear()
        pressures = self.read(timeout).pressures
        working = {puck for puck, identity in identities.items() if identity != protocol.TACTILE_FAILED}
        working -= {puck for puck in Puck if np.isnan(pressures[puck - Puck.F1]).all()}
        if lost := [puck.name for puck in arrays if puck not in working]:
            raise DeviceError(f"{self.name}: cannot be tared; silent, or failed, are the arrays of {', '.join(lost)}.")

    def initialize(self, puck: Puck) -> None:
        """MOVES a joint to its stops, so that its positions count from there; after the present round.

        Fingers first, and the spread when they are open: they may collide otherwise.

        Args:
            puck: of the joint.

        Raises:
            InvalidInputError: if there is no such puck.
            DeviceError: if the hand is not being sampled; nothing is sent then, nor later.
        """
        self._command(self._initialize(Puck(whole_number("puck", puck, least=Puck.F1, most=Puck.SPREAD))))

    def follow(self, request: can.Message, time: float) -> None:
        """Takes a recorded request; a joint that was initialized then counts from there."""
        super().follow(request, time)
        self._note(request)

    def _note(self, request: can.Message) -> None:
        """Takes note of a command that makes positions count anew."""
        if request.data == protocol.encode_set(Property.COMMAND, protocol.INITIALIZE):
            self._joint_encoders.restarted.discard(request.arbitration_id)

    def _command(self, command: Conversation) -> None:
        # A command that waited until the hand is back could move it when nobody expects that.
        if not self._sampling:
            raise DeviceError(f"{self.name}: cannot be commanded; its state: {self.status.removesuffix('.')}.")
        self._commands.append(command)

    def _tare(self, arrays: list[Puck], outcome: list[dict[int, int]]) -> Conversation:
        """Tares the arrays; `outcome` gets their identities.

        A tare is not acknowledged. But who answers the question right before it, has heard it too.
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
        yield Pause(_SETTLE_TIME)  # for answers that are on their way
        for puck in asleep:
            yield Exchange((set_frame(puck, Property.STATUS, PuckStatus.READY),), _ignore, _WAKE_SPACING)
        yield Pause(_WAKE_TIME)

    def _examine(self) -> Generator[Exchange | Pause, bool, tuple[set[Answer], list[str]]]:
        """What the pucks have: the answers to expect of them, and remarks on what is not as it should be."""
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
        """A property of several pucks; those that keep silent are left out."""
        answers = Answers(name, pucks)
        if pucks:
            yield Exchange(tuple(get_frame(puck, name) for puck in pucks), answers.collect, self._timeout)
        return answers.values

    def _sample(self, expected: set[Answer], remarks: list[str]) -> Conversation:
        """Asks in rounds, until a puck that was absent is back."""
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
                # Answers that come a round late could not be told from those of the next round.
                raise DeviceTimeoutError("no puck of the hand answers")
            for answer in expected:
                missed[answer] = missed[answer] + 1 if answer in cycle.missing else 0
            while self._commands:
                yield from self._commands.popleft()
            ask_at = max(ask_at + self._period, self._now)
            yield Pause(ask_at - self._now)

    def _search(self, expected: set[Answer], lost: set[Answer]) -> Generator[Exchange | Pause, bool, bool]:
        """Looks for the pucks that keep silent; whether one of them is back."""
        absent = [puck for puck in Puck if (puck, "position") in lost or (puck, "position") not in expected]
        answers = Answers(Property.STATUS, absent[:1])
        if absent:
            yield Exchange(tuple(get_frame(puck, Property.STATUS) for puck in absent), answers.collect, _SETTLE_TIME)
        # A puck whose array alone keeps silent may have lost its mode.
        mute = [puck for puck in Puck if puck not in absent and (puck, "pressures") in lost]
        for puck in mute:
            yield Exchange((set_frame(puck, Property.TACTILE, self._mode),), _ignore, _SETTLE_TIME)
        return any(puck in answers.values for puck in absent)


def _ignore(_: can.Message) -> bool:
    return False
