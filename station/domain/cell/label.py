"""The label of a unit in ZPL II: serial, verdict, and a QR code that leads to the record. Pure text."""

#: Characters that steer a ZPL printer, and the one that `^FH` makes the escape.
_STEERING = "^~_\\"
#: Longer texts run over the label.
MOST_CHARACTERS = 64


def zpl(serial: str, outcome: str, record: str, nest: str) -> bytes:
    """One label of 50 × 25 mm at 8 dots a mm. Everything from outside is escaped: a serial steers no printer."""
    lines = [
        "^XA^CI28^PW400^LL200",
        f"^FO20,20^A0N,40,40^FH_^FD{_escaped(serial)}^FS",
        f"^FO20,75^A0N,60,60^FH_^FD{_escaped(outcome)}^FS",
        f"^FO20,150^A0N,25,25^FH_^FD{_escaped(nest)}^FS",
        f"^FO270,30^BQN,2,3^FH_^FDMA,{_escaped(record)}^FS",
        "^PQ1^XZ",
    ]
    return "\n".join(lines).encode("utf-8")


def _escaped(text: str) -> str:
    clean = "".join(c for c in text if c.isprintable())[:MOST_CHARACTERS]
    return "".join(f"_{ord(c):02X}" if c in _STEERING else c for c in clean)
