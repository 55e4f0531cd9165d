"""Sends the audit record to collectors of other hands, by syslog over TLS: rsyslog, with GnuTLS and with OpenSSL, and syslog-ng.

Each runs as a process of its own with a configuration of its own. It gets every line as it was written, also those of the time when it was away, and
nothing if its certificate is that of another authority or of another name. What it has kept is a record that `isocortex audit verify` accepts.
"""

import contextlib
import glob
import json
import os
import shutil
import socket
import subprocess
import tempfile
import time

from attack import Report, Server, head, program, skip

EXPORTS = 40
FIELDS = "pri", "host", "program", "process", "kind", "data", "line"

RSYSLOG = """
global(workDirectory="{folder}" defaultNetstreamDriver="{driver}" defaultNetstreamDriverCAFile="{folder}/good-ca.pem" maxMessageSize="64k"
  defaultNetstreamDriverCertFile="{folder}/{certificate}.pem" defaultNetstreamDriverKeyFile="{folder}/{certificate}.key")
module(load="imtcp" streamDriver.name="{driver}" streamDriver.mode="1" streamDriver.authMode="{mode}"{permitted})
template(name="all" type="string" string="%pri%|%hostname%|%app-name%|%procid%|%msgid%|%structured-data%|%msg%\\n")
input(type="imtcp" port="{port}" address="127.0.0.1")
action(type="omfile" file="{folder}/kept" template="all")
"""

SYSLOG_NG = """@version: {version}
source s {{ syslog(ip("127.0.0.1") port({port}) transport("tls") log-msg-size(65536) tls(key-file("{folder}/{certificate}.key")
  cert-file("{folder}/{certificate}.pem") ca-file("{folder}/good-ca.pem") peer-verify({mode}))); }};
destination d {{ file("{folder}/kept" template("$PRI|$HOST|$PROGRAM|$PID|$MSGID|$SDATA|$MSG\\n")); }};
log {{ source(s); destination(d); }};
"""


def openssl(*words):
    subprocess.run(["openssl", *words], check=True, capture_output=True)


def make_certificates(folder):
    """Two authorities, and certificates of them: for the collector, for another host, and for us."""
    curve = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    for authority in ("good", "bad"):
        files = ["-keyout", f"{folder}/{authority}-ca.key", "-out", f"{folder}/{authority}-ca.pem"]
        openssl("req", "-x509", *curve, "-subj", f"/CN={authority}", "-days", "2", *files)
    for name, authority, host in [
        ("collector", "good", "IP:127.0.0.1"),
        ("forged", "bad", "IP:127.0.0.1"),
        ("other", "good", "DNS:other.example"),
        ("ours", "good", "DNS:isocortex"),
        ("theirs", "bad", "DNS:isocortex"),
    ]:
        made = f"{folder}/{name}"
        openssl("req", *curve, "-subj", "/CN=isocortex", "-keyout", f"{made}.key", "-out", f"{made}.csr")
        with open(f"{made}.ext", "w") as file:
            file.write(f"subjectAltName={host}\nextendedKeyUsage=serverAuth,clientAuth\n")
        by = ["-CA", f"{folder}/{authority}-ca.pem", "-CAkey", f"{folder}/{authority}-ca.key", "-CAcreateserial"]
        files = ["-in", f"{made}.csr", "-out", f"{made}.pem", "-extfile", f"{made}.ext"]
        openssl("x509", "-req", *by, *files, "-days", "2")


def installed(name):
    """A program, also where users other than root do not look for it."""
    return shutil.which(name, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")


def version_of(path):
    said = subprocess.run([path, "-v" if path.endswith("rsyslogd") else "--version"], capture_output=True, text=True)
    words = [word.strip("(),:") for word in said.stdout.split()]
    return next(word for word in words if "." in word and word.replace(".", "").isdigit())


class Rsyslog:
    """rsyslog with one of its libraries for TLS."""

    def __init__(self, driver):
        self.driver, self.path = driver, installed("rsyslogd")
        # Beside the program: it may be unpacked anywhere.
        root = os.path.dirname(os.path.dirname(os.path.dirname(self.path or "/usr/sbin/rsyslogd")))
        found = glob.glob(f"{root}/usr/lib/*/rsyslog/lmnsd_{driver}.so")
        self.modules = os.path.dirname(found[0]) if found else None
        self.there = bool(self.path and found)

    def name(self):
        return f"rsyslog {version_of(self.path)} ({self.driver})"

    def command(self, folder, certificate, port, asks):
        mode = "x509/name" if asks else "anon"
        permitted = ' permittedPeer=["isocortex"]' if asks else ""
        text = RSYSLOG.format(**locals(), driver=self.driver)
        with open(f"{folder}/conf", "w") as file:
            file.write(text)
        return [self.path, "-n", "-f", f"{folder}/conf", "-i", f"{folder}/pid", "-M", self.modules]


class SyslogNg:
    """syslog-ng."""

    def __init__(self):
        self.path = installed("syslog-ng")
        self.there = bool(self.path)

    def name(self):
        return f"syslog-ng {version_of(self.path)}"

    def command(self, folder, certificate, port, asks):
        mode = "required-trusted" if asks else "optional-untrusted"
        version = ".".join(version_of(self.path).split(".")[:2])
        text = SYSLOG_NG.format(**locals())
        with open(f"{folder}/conf", "w") as file:
            file.write(text)
        root = os.path.dirname(os.path.dirname(os.path.dirname(self.path)))
        modules = [f"--module-path={path}" for path in glob.glob(f"{root}/usr/lib/syslog-ng/*.*/")]
        files = ["-R", f"{folder}/persist", "-p", f"{folder}/pid", "-c", f"{folder}/control"]
        return [self.path, "-F", "--no-caps", "-f", f"{folder}/conf", *files, *modules]


class Collector:
    """A collector that runs, until `end`."""

    def __init__(self, kind, folder, port, certificate="collector", asks=False):
        command = kind.command(folder, certificate, port, asks)
        with open(f"{folder}/said", "ab") as said:
            self.process = subprocess.Popen(command, stdout=said, stderr=said)
        for _ in range(100):
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port), 1).close()
                return
            time.sleep(0.1)
        with open(f"{folder}/said") as said:
            raise RuntimeError(f"it does not start: {said.read()[-1000:]}")

    def end(self):
        self.process.kill()
        self.process.wait()


def free_port():
    with socket.socket() as any_port:
        any_port.bind(("127.0.0.1", 0))
        return any_port.getsockname()[1]


def kept(folder):
    """The messages that a collector has kept, by their fields."""
    with contextlib.suppress(FileNotFoundError), open(f"{folder}/kept") as file:
        return [dict(zip(FIELDS, line.rstrip("\n").split("|", 6))) for line in file if line.endswith("\n")]
    return []


def recorded(audit):
    lines = []
    for name in sorted(glob.glob(f"{audit}/*.jsonl")):
        with open(name) as file:
            lines += [line.rstrip("\n") for line in file if line.endswith("\n")]
    return lines


def until_kept(folder, audit):
    """What a collector has not got after half a minute."""
    end = time.monotonic() + 45
    while True:
        got = {message["line"].strip() for message in kept(folder)}
        missing = [line for line in recorded(audit) if line not in got]
        if not missing or time.monotonic() > end:
            return missing
        time.sleep(0.2)


def settings(folder, audit, port, certificate=None):
    ours = f'tls_certificate = "{folder}/{certificate}.pem"\ntls_key = "{folder}/{certificate}.key"\n' if certificate else ""
    return (
        f'[audit]\nfolder = "{audit}"\n[audit.syslog]\naddress = "127.0.0.1:{port}"\n'
        f'tls_authority = "{folder}/good-ca.pem"\n{ours}'
    )


def is_accepted(folder, audit, port, certificate=None):
    """What `isocortex audit test` says."""
    path = f"{folder}/test.toml"
    with open(path, "w") as file:
        file.write(settings(folder, audit, port, certificate))
    return subprocess.run([program(), "audit", "test", "--config", path], capture_output=True).returncode == 0


def attack(report, kind, folder):
    make_certificates(folder)
    port, audit = free_port(), f"{folder}/audit"
    os.mkdir(audit)
    collector = Collector(kind, folder, port)
    report.expect("it is accepted", is_accepted(folder, audit, port))
    with Server(settings=settings(folder, audit, port)) as server:
        case = server.prepared(head())

        def export():
            for _ in range(EXPORTS):
                assert server.ask("GET", f"{case}/mask")[0] == 200

        export()
        missing = until_kept(folder, audit)
        report.expect("every line comes", not missing, f"{len(recorded(audit))} lines, {len(missing)} missing")
        message = next((it for it in kept(folder) if '"export"' in it["line"]), {})
        line = json.loads(message.get("line", "{}"))
        fields = [message.get(key) for key in ("pri", "program", "process", "kind")]
        expected = ["85", "isocortex", line.get("process"), "Export"]
        report.expect("with priority, program, process and kind", fields == expected, fields)
        number = f'sequenceId="{line.get("seq")}"'
        report.expect("and its number", number in message.get("data", ""), message.get("data"))
        collector.end()
        export()
        collector = Collector(kind, folder, port)
        missing = until_kept(folder, audit)
        report.expect("those of the time when it was killed come later", not missing, f"{len(missing)} missing")
        for certificate in ("forged", "other"):
            collector.end()
            before = len(kept(folder))
            collector = Collector(kind, folder, port, certificate)
            export()
            refused = not is_accepted(folder, audit, port)
            # The server has tried by then: its pauses are shorter.
            time.sleep(5)
            report.expect(f"nothing comes to the certificate `{certificate}`", refused and len(kept(folder)) == before)
        collector.end()
        collector = Collector(kind, folder, port)
        missing = until_kept(folder, audit)
        report.expect("the rest comes to the right one", not missing, f"{len(missing)} missing")
        server.stop()
    missing = until_kept(folder, audit)
    report.expect("the last lines come", not missing, f"{len(missing)} missing")
    lines = set(recorded(audit))
    changed = [message for message in kept(folder) if message["line"].strip() not in lines]
    report.expect("none is cut or changed", not changed, f"{len(kept(folder))} messages, {len(lines)} lines")
    os.mkdir(f"{folder}/back")
    # Those that came twice are one.
    for line in dict.fromkeys(message["line"].strip() for message in kept(folder)):
        with open(f"{folder}/back/{json.loads(line)['process']}-000001.jsonl", "a") as file:
            file.write(line + "\n")
    verified = subprocess.run([program(), "audit", "verify", f"{folder}/back"], capture_output=True, text=True)
    report.expect("what it has kept is a whole record", verified.returncode == 0, verified.stdout.splitlines()[-1:])
    collector.end()
    collector = Collector(kind, folder, port, asks=True)
    accepted = [is_accepted(folder, audit, port, name) for name in (None, "theirs", "ours")]
    report.expect("if it requires a certificate, ours alone is accepted", accepted == [False, False, True], accepted)
    collector.end()


def main():
    report = Report("collectors of other hands")
    kinds = [kind for kind in (Rsyslog("gtls"), Rsyslog("ossl"), SyslogNg()) if kind.there]
    if not kinds or not shutil.which("openssl"):
        skip("no rsyslogd with rsyslog-gnutls or rsyslog-openssl, and no syslog-ng; or no openssl")
    for kind in kinds:
        report.figure("collector", kind.name())
        folder = tempfile.mkdtemp(prefix="isocortex-collector-")
        try:
            attack(report, kind, folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    report.end()


main()
