"""Every fault the station is tested against, as data: what tests/integration/test_faults.py runs.

docs/faults.md is made of it. inject: see tests/faults/inject.py. flash: what the device holds after the next power-on:
nothing new, all the new values, or a mixture that the record shows. keeps: part of a sentence that the record must
hold whatever the outcome. parked: whether the positioner can still be brought to its parking place.
"""

import re
from dataclasses import dataclass

from station.domain.product.sdo_codes import ABORT

PASS, FAIL, ERROR, ABORTED = "PASS", "FAIL", "ERROR", "ABORTED"
_CODES = {PASS: 0, FAIL: 1, ERROR: 3, ABORTED: 4}


@dataclass(frozen=True, slots=True)
class Row:
    """One fault: in words, how it is injected, the unit's outcome, part of the sentence, and what is left behind."""

    area: str
    fault: str
    inject: str
    outcome: str
    says: str = ""
    flash: str = "nothing new"
    keeps: str = ""
    exit_code: int = -1
    parked: bool = True

    @property
    def kind(self) -> tuple[str, str, str]:
        """Rows of one kind break the same part in the same way and come to the same end: such as two abort codes."""
        where, what = self.inject.split(" ")[:2]
        return f"{where} {re.split('[:=]', what)[0]}", self.outcome, self.flash

    @property
    def code(self) -> int:
        """The exit code of `station run`: that of the outcome unless the row says otherwise."""
        return self.exit_code if self.exit_code >= 0 else _CODES[self.outcome]


def _rows(area: str, *rows: tuple[str, ...]) -> tuple[Row, ...]:
    """Rows of one area: fault, inject, outcome, says, flash, keeps."""
    return tuple(Row(area, *row) for row in rows)  # type: ignore[arg-type]


NEW, MIXED = "new", "mixed"

_WHO = _rows(
    "Who sits in the nest",
    ("no device, or without power", "device deaf", ERROR, "Read of 0x1000:00 from node 17 timed out after 1 s"),
    ("the device hears, but nobody hears it", "device silent", ERROR, "check power, wiring, bit rate and node id"),
    ("another vendor", "device reads:index=0x1018,sub=1,value=5", FAIL, "vendor is 0x5, not 0xCA1B0"),
    ("another product", "device reads:index=0x1018,sub=2,value=7", FAIL, "product code is 0x7"),
    ("an old revision", "device reads:index=0x1018,sub=3,value=1", FAIL, "revision is 0x1, older"),
    ("another device type", "device reads:index=0x1000,sub=0,value=0", FAIL, "device type is 0x0"),
    ("the label is another unit's", "device reads:index=0x1018,sub=4,value=9", ERROR, "but its label says 1"),
    ("two units in each other's nest", "seats swapped", ERROR, "identifies as 2, but its label says 1"),
    ("identity refused", "device refuse:index=0x1018,sub=1,code=0x06020000", FAIL, "the object does not exist"),
    ("two devices with one node id", "device twice", ERROR, "two devices share this node id"),
    ("power lost while it is identified", "device power-cut:at=10", ERROR, "Read of 0x"),
    ("unit exchanged while it is identified", "device other-unit:at=10,value=77", ERROR, "identifies as 77"),
    (
        "unit exchanged after it was measured",
        "device other-unit:at=33,value=77",
        ERROR,
        "77, but was 1",
    ),
    ("unit exchanged while it is verified", "device other-unit:at=105,value=77", ERROR, "77, but was 1", NEW),
)

_OPTIONAL = _rows(
    "What a device need not have",
    ("hardware version refused by another abort code", "device refuse:index=0x1009,code=0x08000000", PASS, "", NEW),
    ("software version refused", "device refuse:index=0x100A,code=0x06010000", PASS, "", NEW),
    ("heartbeat time refused", "device refuse:index=0x1017,code=0x06020000", PASS, "", NEW),
    ("PDO parameters refused", "device refuse:index=0x1800,sub=1,code=0x06020000", PASS, "", NEW),
    ("PDO mapping refused", "device refuse:index=0x1A00,code=0x06010000", PASS, "", NEW),
    (
        "a question never answered",
        "device silent:index=0x1009",
        ERROR,
        "Read of 0x1009:00 from node 17",
    ),
    (
        "the name of the product refused",
        "device refuse:index=0x1008,code=0x06020000",
        FAIL,
        "read 0x1008:00",
    ),
    ("its product code refused", "device refuse:index=0x1018,sub=2,code=0x06090011", FAIL, "0x1018:02"),
    ("its serial refused", "device refuse:index=0x1018,sub=4,code=0x06090011", FAIL, "0x1018:04"),
)

_SENDING = _rows(
    "How it sends",
    (
        "it takes coefficients only while it sends nothing",
        "device refuse:index=0x2101,sub=1,access=write,code=0x08000022,times=1",
        PASS,
        "",
        NEW,
    ),
    ("it takes its output switch only while it sends nothing", "device only-idle:index=0x2106", PASS, "", NEW),
    ("it takes any write only while it sends nothing", "device only-idle", PASS, "", NEW),
    ("its event timer is 0: set for the run", "device holds:index=0x1800,sub=5,value=0", PASS, "", NEW),
    (
        "its event timer is slower than the recipe",
        "device holds:index=0x1800,sub=5,value=50",
        FAIL,
        "Event timer 0x1800:05 of its PDO 1 is 50 ms, but the recipe's rate needs 10 ms",
    ),
    ("it waits for SYNC", "device holds:index=0x1800,sub=2,value=1", PASS, "", NEW),
    ("it waits for every second SYNC", "device holds:index=0x1800,sub=2,value=2", PASS, "", NEW),
    ("it waits for SYNC after an event", "device holds:index=0x1800,sub=2,value=0", PASS, "", NEW),
    ("it sends by event, transmission type 255", "device holds:index=0x1800,sub=2,value=255", PASS, "", NEW),
    ("its PDO is switched off", "device holds:index=0x1800,sub=1,value=0x80000191", PASS, "", NEW),
    (
        "its PDO is off and cannot be switched on",
        "device holds:index=0x1800,sub=1,value=0x80000191 and refuse:index=0x1800,sub=1,access=write,code=0x06010002",
        FAIL,
        "0x1800:01",
    ),
    (
        "its event timer is 0 and cannot be set",
        "device holds:index=0x1800,sub=5,value=0 and refuse:index=0x1800,sub=5,access=write,code=0x06010002",
        ERROR,
        "No readings at 'z-up': event timer 0x1800:05 of its PDO 1 is 0 or missing",
    ),
    (
        "it sends under another identifier",
        "device holds:index=0x1800,sub=1,value=0x1A5 and stream-stops",
        ERROR,
        "none of its PDOs sends 0x191 but 0x1A5",
    ),
    ("it cannot be started", "device not-operational", ERROR, "it is pre-operational although it was started"),
    (
        "it cannot be started, and says why",
        "device not-operational and emergency:code=0x5000,after_s=2",
        ERROR,
        "emergency 0x5000",
    ),
    ("it cannot be started after the reset", "device not-operational:after_s=20", ERROR, "it is pre-operational", NEW),
    ("it falls back in the tumble", "device falls-back:after_s=6", ERROR, "it is pre-operational although"),
    ("it falls back in the verification", "device falls-back:after_s=21", ERROR, "it is pre-operational although", NEW),
    ("it maps other objects before the write", "device remap:after_s=15", ERROR, "its PDO 1 maps other objects than"),
    ("it maps other objects in the verification", "device remap:after_s=24", ERROR, "its PDO 1 maps other", NEW),
    ("it maps other objects in the tumble", "device remap:after_s=6", ERROR, "its PDO 1 maps other objects than"),
    (
        "it maps other objects, and its readings fail for it",
        "device remap:after_s=1 and stuck-axis:value=1",
        ERROR,
        "its PDO 1 maps other objects than",
    ),
    (
        "its output is another one after the tumble",
        "device reads:index=0x2106,sub=0,value=1,at=3",
        ERROR,
        "raw output at 0x2106:00 reads 01, but was set to 00",
    ),
    (
        "its output is another one after the verification",
        "device reads:index=0x2106,sub=0,value=0,at=6",
        ERROR,
        "compensated output at 0x2106:00 reads 00",
        NEW,
    ),
    ("its output switch is not saved: set again", "device forgets:index=0x2106", PASS, "", NEW),
    ("a coefficient is not saved", "device forgets:index=0x2101,sub=4", FAIL, "a mixture of old and new values", MIXED),
    ("no coefficient is saved", "device forgets:index=0x2101 and forgets:index=0x2102", FAIL, "a mixture", MIXED),
)

_TRAFFIC = _rows(
    "Emergencies about the traffic",
    ("a PDO of another node's length", "device emergency:code=0x8210,register=0,after_s=6", PASS, "", NEW),
    ("a PDO too long", "device emergency:code=0x8220,register=0x11,after_s=6", PASS, "", NEW),
    ("another node's PDO is late", "device emergency:code=0x8250,register=0,after_s=6", PASS, "", NEW),
    (
        "it lost frames of others",
        "device emergency:code=0x8110,register=0x11,after_s=6",
        PASS,
        "",
        NEW,
    ),
    ("its controller was passive", "device emergency:code=0x8120,register=0x10,after_s=6", PASS, "", NEW),
    ("another node's heartbeat is missing", "device emergency:code=0x8130,register=0x11,after_s=6", PASS, "", NEW),
    ("it came back from bus-off", "device emergency:code=0x8140,register=0x11,after_s=6", PASS, "", NEW),
    ("an error that is gone again", "device emergency:code=0x0000,register=0,after_s=6", PASS, "", NEW),
    (
        "traffic and an own error",
        "device emergency:code=0x8210,register=0x81,after_s=6",
        FAIL,
        "emergency 0x8210",
    ),
    ("traffic during verification", "device emergency:code=0x8220,register=0,after_s=23", PASS, "", NEW),
    ("a storm of them, 2,000 in 2 s", "device emergency:code=0x8210,register=0,after_s=5,times=2000", PASS, "", NEW),
    (
        "a storm of them while it is written",
        "device emergency:code=0x8210,register=0,after_s=19,times=3000",
        PASS,
        "",
        NEW,
    ),
    (
        "a storm about hardware",
        "device emergency:code=0x5000,register=1,after_s=5,times=2000",
        FAIL,
        "emergency 0x5000",
    ),
    ("hardware, error register 0", "device emergency:code=0x5000,register=0,after_s=6", FAIL, "emergency 0x5000"),
)

_STRANGE = _rows(
    "Answers that nobody asked for",
    ("an early answer while it is identified", "device early:at=3,times=1", PASS, "", NEW),
    ("an early answer while old values are read", "device early:at=20,times=1", PASS, "", NEW),
    (
        "an early confirmation of the next coefficient",
        "device early:index=0x2101,sub=4,access=write,times=1",
        PASS,
        "",
        NEW,
    ),
    ("early answers to each coefficient", "device early:index=0x2101,access=write", PASS, "", NEW),
    ("early answers without end", "device early", ERROR, "two devices share this node id"),
    ("one answer under another node id", "device other-id:at=12,times=1", ERROR, "timed out after 1 s"),
    ("every answer under another node id", "device other-id", ERROR, "Read of 0x1000:00 from node 17 timed out"),
    (
        "the same from the middle of the write on",
        "device other-id:index=0x2101,sub=4,access=write",
        ERROR,
        "Write to 0x2101:04",
    ),
    ("save confirmed under another node id", "device other-id:index=0x1010", PASS, "", NEW),
    (
        "the unlock answered for another",
        "device wrong-object:index=0x2104,value=0x2101",
        ERROR,
        "Write to 0x2104",
    ),
    ("the save answered for another object", "device wrong-object:index=0x1010,value=0x1011", PASS, "", NEW),
    ("toggle bit wrong while the record is written", "device wrong-toggle:index=0x2100", ERROR, "0x2100"),
    ("each coefficient confirmed twice", "device twice:index=0x2101,access=write", PASS, "", NEW),
    (
        "a coefficient reads as its neighbour does",
        "device wrong-object:index=0x2101,sub=4,value=0x2102,access=read,at=2",
        ERROR,
        "Read of 0x2101:04",
    ),
)

_ANSWERS = _rows(
    "Answers on the bus",
    ("every answer 0.5 s late", "device late:seconds=0.5", PASS, "", NEW),
    ("one answer 3 s late", "device late:seconds=3,at=12,times=1", ERROR, "timed out after 1 s"),
    ("one answer comes twice: a bus may do that", "device stale:at=12,times=1", PASS, "", NEW),
    ("every answer comes twice, the second late", "device stale", ERROR, "two devices share this node id"),
    ("the same from one point on", "device stale:at=30", ERROR, "two devices share this node id"),
    ("the same in the middle of the write", "device stale:at=60", ERROR, "two devices share this node id"),
    (
        "one answer for another object",
        "device wrong-object:at=12,times=1,value=8192",
        ERROR,
        "a wrong toggle bit",
    ),
    (
        "a coefficient answered as another one",
        "device wrong-object:index=0x2101,sub=4,value=0x2102",
        ERROR,
        "1 answer came that does not fit the request",
    ),
    ("toggle bit wrong in a segment", "device wrong-toggle", ERROR, "a wrong toggle bit"),
    ("a node babbles with the highest priority", "device babble:after_s=26", PASS, "", NEW),
    ("it babbles from the start, and others get through", "device babble", PASS, "", NEW),
)

_STREAM = _rows(
    "Readings",
    ("no readings at all", "device frames-lost:fraction=1", ERROR, "No readings at 'z-up'"),
    ("cable out during the tumble", "device stream-stops:after_s=6", ERROR, "No readings at 'x-up'"),
    ("cable out during verification", "device stream-stops:after_s=22", ERROR, "No readings at 'verify-x'", NEW),
    ("frame counter stuck", "device counter-stuck", FAIL, "the frame counter is stuck"),
    ("its status says that its self-test failed", "device status:value=1", FAIL, "status says 'self-test failed' in"),
    ("a fifth of the CRCs wrong", "device crc-errors:fraction=0.2", FAIL, "frames with a wrong CRC"),
    ("a fifth of the frames lost", "device frames-lost:fraction=0.2", FAIL, "frames lost at"),
    ("a fifth of the frames repeated", "device frames-repeated:fraction=0.2", FAIL, "frames repeated"),
    ("a fifth of the frames swapped", "device frames-swapped:fraction=0.2", FAIL, "frames out of order"),
    ("an axis stands still", "device stuck-axis:value=1", FAIL, "Axis y reads exactly"),
    (
        "its clock 20 % fast",
        "device clock-fast:fraction=0.2",
        FAIL,
        "rate at 'z-up' is 120.0 Hz; the recipe says 100 Hz",
    ),
    ("its clock 5 % fast", "device clock-fast:fraction=0.05", FAIL, "rate at 'z-up' is 105.0 Hz"),
    ("EMCY during the tumble", "device emergency:code=0x4210,after_s=6", FAIL, "emergency 0x4210"),
    ("EMCY during the first move", "device emergency:code=0x2310,seconds=2", FAIL, "emergency 0x2310"),
    ("EMCY during verification", "device emergency:code=0x2310,after_s=25", FAIL, "at 'verify-tilt'", NEW),
    ("heartbeat lost", "device heartbeat-stops:after_s=5", FAIL, "No heartbeat for"),
    ("heartbeats far rarer than it announces", "device heartbeat-slow:seconds=5", FAIL, "A heartbeat came only every"),
    ("it says that it has no heartbeat", "device reads:index=0x1017,sub=0,value=0", PASS, "", NEW),
    (
        "thermometer frozen inside its limits: a warning",
        "device thermometer-frozen",
        PASS,
        "",
        NEW,
        "never moved by a step of 0.01 °C",
    ),
    ("too warm for the recipe", 'recipe limits={"temperature_degC": [-10, 10]}', ERROR, ", outside -10 to 10 °C"),
    ("restart during the tumble", "device spontaneous-reset:after_s=6", FAIL, "restarted by itself at 'x-up'"),
    ("restart during verification", "device spontaneous-reset:after_s=22", FAIL, "restarted by itself at", NEW),
    (
        "raw output cannot be switched on",
        "device reads:index=0x2106,sub=0,value=1",
        FAIL,
        "raw output reads 01 after 00",
    ),
)

_RESETS = _rows(
    "Resets at every step",
    ("while its identity is read", "device reboot:at=3", ERROR, "Read of 0x1018:02 from node 17 timed out"),
    ("while its old values are read", "device reboot:at=20", ERROR, "Read of 0x2101:08 from node 17 timed out"),
    ("while it is made ready", "device reboot:at=33", FAIL, "restarted by itself"),
    ("at the unlock", "device reboot:index=0x2104", FAIL, "restarted by itself"),
    ("at the first coefficient", "device reboot:at=40", FAIL, "restarted by itself"),
    ("between the coefficients", "device reboot:at=60", FAIL, "restarted by itself"),
    ("power gone for 1 s between the coefficients", "device power-cut:at=60,seconds=1", FAIL, "restarted by itself"),
    ("power gone for good between the coefficients", "device power-cut:at=60", ERROR, "timed out after"),
    ("at a coefficient's write", "device power-cut:index=0x2101,sub=4,access=write,seconds=1", FAIL, "restarted by"),
    ("before the save", "device reboot:at=75", FAIL, "restarted by itself"),
    ("at the save", "device reboot:index=0x1010", FAIL, "holds old values after save and reset"),
    ("power gone for 1 s at the save", "device power-cut:index=0x1010,seconds=1", FAIL, "holds old values after save"),
    ("power gone for good at the save", "device power-cut:index=0x1010", ERROR, "sent no boot-up message within 5 s"),
)

_WRITES = _rows(
    "Writing",
    ("one coefficient is kept wrongly", "device reads:index=0x2101,sub=3,value=0.5", FAIL, "reads back 0000003f"),
    (
        "an offset is kept wrongly",
        "device reads:index=0x2102,sub=1,value=0.25",
        FAIL,
        "offset.x at 0x2102:01 reads back",
    ),
    ("its checksum is wrong", "device reads:index=0x2105,sub=0,value=3", FAIL, "computes the checksum 00000003"),
    (
        "the answer to a write 3 s late",
        "device late:seconds=3,index=0x2101,sub=4,access=write,times=1",
        ERROR,
        "Write to 0x2101:04",
    ),
    ("a write done but not answered", "device silent:index=0x2101,sub=4,access=write", ERROR, "Write to 0x2101:04"),
    ("a write not heard", "device deaf:index=0x2101,sub=4,access=write", ERROR, "Write to 0x2101:04"),
    ("silent from the middle of the write on", "device silent:at=61", ERROR, "Write to 0x"),
    ("deaf from the middle of the write on", "device deaf:at=61", ERROR, "Write to 0x"),
    ("the unlock done but not answered", "device silent:index=0x2104", ERROR, "Write to 0x"),
)

_SAVES = _rows(
    "Saving",
    ("save fails", "device save-fails", FAIL, "0x1010:01: hardware error"),
    ("save confirmed, nothing kept", "device save-lies", FAIL, "holds old values after save and reset"),
    ("power lost half-way through the save", "device save-torn", ERROR, "sent no boot-up message", MIXED),
    ("power lost half-way through the save, and back", "device save-torn:seconds=1", FAIL, "a mixture of", MIXED),
    ("save done but not answered", "device silent:index=0x1010", PASS, "", NEW),
    ("save not heard", "device deaf:index=0x1010", FAIL, "holds old values after save and reset"),
    ("save answered 6 s late", "device late:seconds=6,index=0x1010", PASS, "", NEW),
    ("no boot-up message at all", "device no-boot-up", ERROR, "sent no boot-up message within 5 s", NEW),
    ("no boot-up message after the reset", "device no-boot-up:at=2", ERROR, "sent no boot-up message within 5 s", NEW),
)

_BUS = _rows(
    "The bus and its adapter",
    ("bus-off in a dwell", "bus bus-off at 4.5 s", ERROR, "the controller is bus-off: check wiring, termination"),
    ("bus-off while the fixture moves", "bus bus-off at 6.0 s", ERROR, "the controller is bus-off"),
    ("error-passive in a dwell", "bus error-passive at 4.5 s", PASS, "", NEW, "error passive while receiving"),
    ("error-passive while the fixture moves", "bus error-passive at 6.0 s", PASS, "", NEW, "error passive while rec"),
    ("error-passive while it is written", "bus error-passive at 20.0 s", PASS, "", NEW, "error passive while receiv"),
    ("a frame nobody acknowledged", "bus no-acknowledge at 4.5 s", PASS, "", NEW, "no node acknowledged a frame"),
    ("bit errors", "bus bit-error at 4.5 s", PASS, "", NEW, "single bit error"),
    ("the adapter's buffer overflowed", "bus overflow at 4.5 s", PASS, "", NEW, "receive buffer overflowed"),
)

_WIRE = _rows(
    "Cable, link and bit rate",
    ("the station's bit rate is wrong", "wire wrong-bit-rate", ERROR, "is bus-off: check bit rate, wiring"),
    ("the cable is out from the start", "wire cable-out", ERROR, "no node acknowledges its frames: check cable"),
    ("cable out in a dwell, for good", "wire cable-out:after_s=8.3", ERROR, "No heartbeat for"),
    (
        "cable out and in again in a dwell: measured once more",
        "wire cable-out:after_s=8.3,seconds=1",
        PASS,
        "",
        NEW,
        "readings at 'x-up',",
    ),
    ("cable out and in again during a move", "wire cable-out:after_s=6,seconds=1", PASS, "", NEW),
    (
        "cable out and in again in the middle of the write",
        "wire cable-out:after_s=19.765,seconds=0.3",
        ERROR,
        "timed out after 1 s",
    ),
    (
        "cable out in the middle of the write, for 3 s",
        "wire cable-out:after_s=19.765,seconds=3",
        ERROR,
        "timed out after 1 s",
    ),
    ("cable out in the middle of the write, for good", "wire cable-out:after_s=19.765", ERROR, "no node acknowledges"),
    ("the link is down from the start", "wire link-down", ERROR, "went down: bring it up with `ip link set"),
    ("link down in the tumble", "wire link-down:after_s=6", ERROR, "went down: bring it up with `ip link set"),
    ("link down and up again in the tumble", "wire link-down:after_s=6,seconds=1", ERROR, "went down: bring it up"),
    ("link down and up in the middle of the write", "wire link-down:after_s=19.765,seconds=0.2", ERROR, "went down"),
    ("link down between save and reset", "wire link-down:after_s=20.3,seconds=1", ERROR, "went down: bring it up", NEW),
    ("nothing can be sent (ENOBUFS)", "wire queue-full", ERROR, "could not send for 1 s because its queue is full"),
    ("nothing can be sent in the middle of the write", "wire queue-full:after_s=19.765", ERROR, "its queue is full"),
    ("a full queue empties within its time", "wire queue-full:after_s=19.765,seconds=0.5", PASS, "", NEW),
    ("a node babbles and nobody else gets through", "wire jammed", ERROR, "Read of 0x1000"),
    ("the same in the tumble", "wire jammed:after_s=6", ERROR, "No heartbeat for"),
)

_GOLD = _rows(
    "The gold reference",
    ("it is dead", "gold deaf", ERROR, "Gold reference G1 cannot be started, so there is no truth"),
    (
        "it refuses raw output",
        "gold refuse:index=0x2106,code=0x08000022",
        ERROR,
        "Gold reference G1 cannot be started",
    ),
    (
        "it falls silent in a dwell",
        "gold stream-stops:after_s=4.6",
        ERROR,
        "Gold reference G1 (node 5) sent 0 of 100",
    ),
    ("it falls silent after the write", "gold stream-stops:after_s=22", ERROR, "Gold reference G1 (node 5)", NEW),
    ("a third of its frames is lost", "gold frames-lost:fraction=0.3", ERROR, "Gold reference G1 (node 5) sent"),
    ("it is past its due date", "gold due=2020-01-31", ERROR, "expired on 2020-01-31"),
)

_RIG = (
    *_rows(
        "The fixture",
        (
            "the positioner stands 90 degrees off",
            "positioner fault=wrong-place,after=2",
            ERROR,
            "90.0° away from",
        ),
    ),
    Row(
        "The fixture",
        "the positioner is stuck",
        "positioner fault=stuck,after=2",
        ERROR,
        "did not reach position 'x-up' within 60 s",
        parked=False,
    ),
    Row(
        "The fixture",
        "the positioner is a thousand times too slow",
        "positioner fault=slow,after=2",
        ERROR,
        "did not reach position 'x-up' within 60 s",
        parked=False,
    ),
    Row(
        "The fixture",
        "it stands wrongly and its encoder lies",
        "positioner fault=wrong-place,after=0,encoder_lies=true",
        ERROR,
        "-x is up at 'z-down' instead of -z",
        parked=False,
    ),
    Row(
        "The fixture",
        "the positioner is stuck after the write",
        "positioner fault=stuck,after=6",
        ERROR,
        "did not reach position 'verify-x' within 60 s",
        NEW,
        parked=False,
    ),
    Row(
        "The fixture",
        "the computer's clock is set back by an hour during a dwell",
        "clock steps back 3600 s at stop 2",
        PASS,
        "",
        NEW,
    ),
)

_LOG = _rows(
    "The log",
    ("the disk is full", "log full at stop 2", ERROR, "cannot be written: the disk is full"),
    ("the file became read-only", "log read-only at stop 2", ERROR, "cannot be written: it is read-only"),
    ("another program locks the file", "log locked at stop 2", ERROR, "another program has locked it"),
    ("the file is no log", "log garbage", ERROR, "it is not a station log, or its first page is damaged"),
    ("a newer station wrote the log", "log newer", ERROR, "was written by a newer station"),
    ("its folder does not exist", "log nowhere", ERROR, "its folder does not exist; create it first"),
    ("another station owns the log", "log in use", ERROR, "is in use by bench-7"),
)

_STOPS = (
    *_rows(
        "The operator's stop",
        ("while the units are identified", "stop at identify", ABORTED, "Stopped by the operator"),
        ("before the tumble", "stop at measure", ABORTED, "Stopped by the operator"),
        ("while the fit is computed", "stop at judge", ABORTED, "Stopped by the operator"),
        ("before the first write", "stop at write", ABORTED, "Stopped by the operator"),
        ("before the save: the unit is finished first", "stop at save", ABORTED, "Stopped by the operator", NEW),
        ("before the reset: the unit is finished first", "stop at restart", ABORTED, "Stopped by the operator", NEW),
        ("before the verification", "stop at verify", ABORTED, "Stopped by the operator", NEW),
    ),
)

_REFUSED = tuple(
    Row("Every SDO abort code", f"{what}: {meaning}", f"device refuse:{where},access=write,code=0x{code:08X}", FAIL,
        f"(abort code 0x{code:08X})")
    for what, where, codes in (
        ("coefficient refused", "index=0x2102,sub=2", tuple(ABORT)),
        ("unlock refused", "index=0x2104", (0x08000020, 0x08000021, 0x08000022, 0x06090030)),
        ("save refused", "index=0x1010", (0x08000020, 0x08000021, 0x08000022, 0x06060000)),
        ("validation refused", "index=0x2107", (0x08000022, 0x06010002)),
        ("raw output refused", "index=0x2106", (0x08000022,)),
    )
    for code, meaning in ABORT.items()
    if code in codes
)  # fmt: skip

ROWS: tuple[Row, ...] = (
    *_WHO,
    *_OPTIONAL,
    *_SENDING,
    *_TRAFFIC,
    *_ANSWERS,
    *_STRANGE,
    *_STREAM,
    *_RESETS,
    *_WRITES,
    *_SAVES,
    *_BUS,
    *_WIRE,
    *_GOLD,
    *_RIG,
    *_LOG,
    *_STOPS,
    *_REFUSED,
)
