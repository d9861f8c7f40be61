"""Ways by which an alert of the watch reaches people: a webhook, and mail by SMTP."""
