"""An alert as a mail, by SMTP (RFC 5321) with STARTTLS (RFC 3207) unless it says otherwise."""

import json
import smtplib
import ssl
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from email.message import EmailMessage
from email.utils import format_datetime
from hashlib import sha256
from typing import Any, Literal

_TIMEOUT_S = 20.0


@dataclass(frozen=True, slots=True)
class MailAccount:
    """Where mail is handed over. security: starttls, tls from the first byte, or none; user "": without a login."""

    host: str
    port: int
    security: Literal["starttls", "tls", "none"]
    user: str
    password: str


class Mail:
    """Mail to one or several people."""

    def __init__(self, account: MailAccount, sender: str, to: Sequence[str]) -> None:
        self._account, self._sender, self._to = account, sender, tuple(to)
        self.name = f"mail to {', '.join(to)}"

    def send(self, document: Mapping[str, Any]) -> None:
        """See AlertChannel.send. A mail of one alert has always the same Message-ID, should it be sent twice."""
        account = self._account
        kind = smtplib.SMTP_SSL if account.security == "tls" else smtplib.SMTP
        try:
            with kind(account.host, account.port, timeout=_TIMEOUT_S) as server:
                if account.security == "starttls":
                    server.starttls(context=ssl.create_default_context())
                if account.user:
                    server.login(account.user, account.password)
                server.send_message(self._message(document))
        except (smtplib.SMTPException, UnicodeError) as error:
            raise OSError(" ".join(str(error).split())) from error

    def _message(self, document: Mapping[str, Any]) -> EmailMessage:
        mail = EmailMessage()
        subject = f"[{document['alert']['station']}] {document['text'][0]}"
        mail["Subject"] = "".join(c if c.isprintable() else " " for c in subject)
        mail["From"], mail["To"] = self._sender, ", ".join(self._to)
        mail["Date"] = format_datetime(datetime.fromisoformat(document["at"]))
        digest = sha256(str(document["id"]).encode()).hexdigest()[:32]
        mail["Message-ID"] = f"<{digest}@{self._sender.rpartition('@')[2]}>"
        mail["Auto-Submitted"] = "auto-generated"
        mail.set_content("\n".join(document["text"]) + "\n")
        data = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
        mail.add_attachment(data, maintype="application", subtype="json", filename="alert.json")
        return mail
