#!/bin/bash
# Succeeds when the server of this container answers GET /healthz with 200. It needs no curl: bash opens the socket.
port=${ISOCORTEX_LISTEN##*:}
exec 3<>"/dev/tcp/127.0.0.1/${port:-8640}" || exit 1
# By TLS, bash sees no more than that the server accepts connections.
[ -z "${ISOCORTEX_TLS_CERT:-}" ] || exit 0
printf 'GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' >&3
read -r -t 4 _ status _ <&3
[ "$status" = 200 ]
