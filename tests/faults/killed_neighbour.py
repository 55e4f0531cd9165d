"""Kills the server (SIGKILL) while a PACS stores images by STOW-RS and C-STORE, and while results are sent back.

Afterwards every image that was acknowledged is there, every result that was acknowledged has been sent, and what was sent more than
once is one object: the same instance UID, the same bytes.
"""

import http.server
import json
import random
import re
import socket
import struct
import threading
import time

from attack import Report, Server, head, is_short

MR = "1.2.840.10008.5.1.4.1.1.4"
EXPLICIT = "1.2.840.10008.1.2.1"
BOUNDARY = "isocortex-neighbour"
IMAGES = 3


def element(group, number, vr, value):
    """An element in Explicit VR Little Endian."""
    if isinstance(value, str):
        value = value.encode() + (b"" if len(value) % 2 == 0 else b"\0" if vr == "UI" else b" ")
    start = struct.pack("<HH", group, number) + vr.encode()
    return start + (struct.pack("<HI", 0, len(value)) if vr in ("OB", "OW") else struct.pack("<H", len(value))) + value


def data_set(series, number):
    """An image of 16 x 16 pixels, without a header."""
    short = lambda value: struct.pack("<H", value)
    return b"".join(
        [
            element(0x08, 0x16, "UI", MR),
            element(0x08, 0x18, "UI", f"{series}.{number}"),
            element(0x08, 0x60, "CS", "MR"),
            element(0x10, 0x20, "LO", "P-1"),
            element(0x20, 0x0D, "UI", "1.2.3"),
            element(0x20, 0x0E, "UI", series),
            element(0x28, 0x02, "US", short(1)),
            element(0x28, 0x04, "CS", "MONOCHROME2"),
            element(0x28, 0x10, "US", short(16)),
            element(0x28, 0x11, "US", short(16)),
            element(0x28, 0x100, "US", short(16)),
            element(0x28, 0x101, "US", short(16)),
            element(0x28, 0x102, "US", short(15)),
            element(0x28, 0x103, "US", short(0)),
            element(0x7FE0, 0x10, "OW", struct.pack("<256H", *((number * 7 + i) % 4096 for i in range(256)))),
        ]
    )


def file_of(series, number):
    meta = b"".join(
        [
            element(0x02, 0x01, "OB", b"\0\1"),
            element(0x02, 0x02, "UI", MR),
            element(0x02, 0x03, "UI", f"{series}.{number}"),
            element(0x02, 0x10, "UI", EXPLICIT),
        ]
    )
    return bytes(128) + b"DICM" + element(0x02, 0x00, "UL", struct.pack("<I", len(meta))) + meta + data_set(series, number)


def stow(server, series):
    """Whether the images of a series are acknowledged."""
    parts = [
        f"--{BOUNDARY}\r\nContent-Type: application/dicom\r\n\r\n".encode() + file_of(series, number) + b"\r\n"
        for number in range(1, IMAGES + 1)
    ]
    kind = {"Content-Type": f'multipart/related; type="application/dicom"; boundary={BOUNDARY}'}
    body = b"".join(parts) + f"--{BOUNDARY}--\r\n".encode()
    return server.ask("POST", "/dicomweb/studies", body, kind, timeout=20)[0] == 200


class Association:
    """Stores images by C-STORE; only what that takes."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        item = lambda kind, value: struct.pack(">BxH", kind, len(value)) + value
        context = struct.pack(">Bxxx", 1) + item(0x30, MR.encode()) + item(0x40, EXPLICIT.encode())
        user = item(0x51, struct.pack(">I", 16384)) + item(0x52, b"1.2.3.4")
        variable = item(0x10, b"1.2.840.10008.3.1.1.1") + item(0x20, context) + item(0x50, user)
        self.send(1, struct.pack(">Hxx", 1) + b"ISOCORTEX".ljust(16) + b"STORESCU".ljust(16) + bytes(32) + variable)
        kind, _ = self.receive()
        if kind != 2:
            raise OSError("the association is not accepted")
        self.message = 0

    def send(self, kind, body):
        self.socket.sendall(struct.pack(">BxI", kind, len(body)) + body)

    def exactly(self, count):
        received = b""
        while len(received) < count:
            more = self.socket.recv(count - len(received))
            if not more:
                raise OSError("the server is gone")
            received += more
        return received

    def receive(self):
        kind, length = struct.unpack(">BxI", self.exactly(6))
        return kind, self.exactly(length)

    def store(self, series, number):
        """Whether an image is acknowledged."""
        self.message += 1
        implicit = lambda element, value: struct.pack("<HHI", 0, element, len(value)) + value
        uid = lambda text: text.encode() + b"\0" * (len(text) % 2)
        short = lambda value: struct.pack("<H", value)
        command = b"".join(
            [
                implicit(0x0002, uid(MR)),
                implicit(0x0100, short(1)),
                implicit(0x0110, short(self.message)),
                implicit(0x0700, short(0)),
                implicit(0x0800, short(0)),
                implicit(0x1000, uid(f"{series}.{number}")),
            ]
        )
        command = implicit(0x0000, struct.pack("<I", len(command))) + command
        for flags, value in ((3, command), (2, data_set(series, number))):
            self.send(4, struct.pack(">IBB", len(value) + 2, 1, flags) + value)
        kind, body = self.receive()
        status = re.search(rb"\x00\x00\x00\x09\x02\x00\x00\x00(..)", body, re.DOTALL)
        return kind == 4 and status is not None and status[1] == b"\0\0"


class Node:
    """A node of a PACS that takes its time, and keeps what it is sent."""

    def __init__(self, seconds):
        received = self.received = {}
        self.bodies = 0
        self.seconds = seconds
        node = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                node.bodies += 1
                at = body.index(b"\x08\0\x18\0UI") + 6
                length = struct.unpack_from("<H", body, at)[0]
                uid = body[at + 2 : at + 2 + length].rstrip(b"\0").decode()
                start = body.index(b"DICM")
                # Boundaries may differ; the object lies before the last one.
                received.setdefault(uid, set()).add(body[start : body.rindex(b"\r\n--")])
                time.sleep(node.seconds)
                item = {"00081155": {"vr": "UI", "Value": [uid]}}
                report = json.dumps({"00081199": {"vr": "SQ", "Value": [item]}}).encode()
                try:
                    self.send_response(200)
                    self.send_header("Content-Length", str(len(report)))
                    self.end_headers()
                    self.wfile.write(report)
                except OSError:
                    pass

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.url = f"http://127.0.0.1:{self.server.server_port}/rs"


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def settings(dimse, node):
    return f"""
[pacs]
stable_seconds = 3600

[pacs.dimse]
listen = "127.0.0.1:{dimse}"

[[pacs.dimse.peers]]
aet = "STORESCU"
address = "127.0.0.1"

[[pacs.nodes]]
name = "receiver"
url = "{node.url}"
"""


def in_the_middle(server, chance, work, longest):
    """Kills the server at a random moment of work, and starts it again."""
    thread = threading.Thread(target=work)
    thread.start()
    time.sleep(chance.uniform(0.05, longest))
    server.process.kill()
    server.process.wait(60)
    thread.join()
    server.start()


def stored(server):
    """The number of images of each series that came."""
    counts, after = {}, ""
    while True:
        page = server.json(f"/v1/arrivals?limit=200{after}")
        counts.update({arrival["series"]: arrival["instances"] for arrival in page["arrivals"]})
        if "next" not in page:
            return counts
        after = f"&after={page['next']}"


def main():
    kills = 3 if is_short() else 40
    chance = random.Random(1)
    report = Report(f"{kills} kills in the middle of STOW-RS, of C-STORE and of sending")
    node, dimse = Node(0.3), free_port()
    with Server(settings=settings(dimse, node)) as server:
        acknowledged, began = {}, 0

        def by_stow():
            nonlocal began
            while True:
                began += 1
                series = f"1.2.3.1.{began}"
                if not stow(server, series):
                    return
                acknowledged[series] = IMAGES

        def by_c_store():
            nonlocal began
            try:
                association = Association(dimse)
                while True:
                    began += 1
                    series = f"1.2.3.2.{began}"
                    for number in range(1, IMAGES + 1):
                        if not association.store(series, number):
                            return
                        acknowledged[series] = number
            except OSError:
                pass

        for name, work in (("STOW-RS", by_stow), ("C-STORE", by_c_store)):
            acknowledged.clear()
            for _ in range(kills):
                in_the_middle(server, chance, work, 1.5)
            there = stored(server)
            lost = {series: count for series, count in acknowledged.items() if there.get(series, 0) < count}
            report.figure(f"images acknowledged by {name}", sum(acknowledged.values()))
            report.expect(f"images were acknowledged by {name}", len(acknowledged) > kills, len(acknowledged))
            report.expect(f"no image acknowledged by {name} is lost", not lost, lost)
            more = {series for series, count in there.items() if count > IMAGES}
            report.expect("no image is there twice", not more, more)

        case = server.prepared(head(8.0))
        results = []

        def request():
            while True:
                asked = {
                    "what": "view",
                    "render": {"depth_mm": 1 + len(results) % 40 / 4, "width": 128 + len(results) // 40, "height": 128},
                    "node": "receiver",
                    # Not the study of the images, which has a thousand series by now: to compare their patients takes longer than the time between two kills.
                    "study": {"StudyInstanceUID": "1.2.4", "PatientID": "P-1"},
                }
                status, headers, body = server.ask("POST", f"{case}/dicom-results", json.dumps(asked), timeout=20)
                if status != 202:
                    return
                results.append((headers["location"], json.loads(body)["instance"]))

        for _ in range(kills):
            in_the_middle(server, chance, request, 2.5)
        # It was slow so that a kill comes in the middle of a result.
        node.seconds = 0
        waiting, end = dict(results), time.monotonic() + 600
        while waiting and time.monotonic() < end:
            states = {address: (server.json(address) or {}).get("state") for address in waiting}
            waiting = {address: uid for address, uid in waiting.items() if states[address] != "done"}
            time.sleep(0.2)
        report.figure("results acknowledged, and bodies that the node received", (len(results), node.bodies))
        report.expect("results were acknowledged", len(results) > kills, len(results))
        report.expect("every acknowledged result was sent", not waiting, len(waiting))
        absent = {uid for _, uid in results if uid not in node.received}
        report.expect("the node has every one", not absent, len(absent))
        twice = {uid for uid, objects in node.received.items() if len(objects) > 1}
        report.expect("what was sent again is the same object", not twice, twice)
        # A result whose acknowledgement was cut off may be there, too; it was requested once as well.
        most = len({uid for _, uid in results}) + kills
        report.expect("no result became two objects", len(node.received) <= most, (len(node.received), most))
        server.stop()
        status, words = server.check()
        report.expect("every object is there and whole", status == 0, words.strip()[-300:])
    report.end()


main()
