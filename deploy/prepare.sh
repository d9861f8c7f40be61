#!/bin/sh
# Keys, passwords and the first station of a new deployment, made once; what is there already stays.
set -eu
cd "$(dirname "$0")"
umask 077
mkdir -p secrets
if [ ! -f secrets/database ]; then
    openssl rand -hex 24 > secrets/database
    printf 'postgresql:5432:plant:plant:%s\n' "$(cat secrets/database)" > secrets/pgpass
    chmod 644 secrets/database   # read by the database's own user in its container
    chmod 600 secrets/pgpass
fi
if [ ! -f config/station.key ]; then
    openssl genpkey -algorithm ed25519 -out config/station.key
    openssl pkey -in config/station.key -pubout -out config/station.pub
    openssl rand -hex 32 > config/plant.token
    digest=$(tr -d '\n' < config/plant.token | openssl dgst -sha256 -r | cut -d ' ' -f 1)
    printf '  - {name: bench-1, public_key: /config/station.pub, token_sha256: %s}\n' "$digest" >> config/plant.yaml
fi
# The services run as user 10001 and read, never write, what is in config.
chown -R 10001 config secrets/pgpass 2>/dev/null || echo "prepare.sh: run as root, or let user 10001 read config/ and secrets/pgpass" >&2
