"""What others can read: modes of files, and words of a client in errors and logs.

A client puts a canary wherever it may write: keys and values of queries, JSON, part names, headers, ids. No answer that
is an error and no line of the log may repeat it. The data folder and a token's file are for their owner alone.
"""

import os
import stat
import tempfile

from attack import BOUNDARY, FORM, Report, Server, form, head

CANARY = "Kanarienvogel"


def requests(case):
    bad = f"/v1/cases/{CANARY}"
    yield "GET", f"/{CANARY}", None, {}
    yield "GET", bad, None, {}
    yield "GET", f"{case}/{CANARY}", None, {}
    for route in ("render", "mesh", "slices/axial", "volume", "distance", "paths", "quality", "mask", "envelope", "triangles"):
        yield "GET", f"{case}/{route}?{CANARY}=1", None, {}
        for key in ("depth_mm", "view", "renderer", "width", "colormap", "window", "position_mm", "format", "paths", "contours"):
            yield "GET", f"{case}/{route}?{key}={CANARY}", None, {}
    yield "GET", f"{case}/slices/{CANARY}", None, {}
    yield "GET", f"/v1/cases?after={CANARY}", None, {}
    yield "GET", f"/v1/cases?limit={CANARY}", None, {}
    json_type = {"Content-Type": "application/json"}
    for body in (
        f'{{"{CANARY}": 1}}',
        f'{{"renders": [{{"{CANARY}": 1}}]}}',
        f'{{"renders": [{{"view": "{CANARY}"}}]}}',
        f'{{"renders": [{{"depth_mm": "{CANARY}"}}]}}',
        f'{{"renders": "{CANARY}"}}',
        f"{CANARY}",
    ):
        yield "POST", f"{case}/renders", body.encode(), json_type
    for parameters in (
        f'{{"{CANARY}": 1}}',
        f'{{"mask": "{CANARY}"}}',
        f'{{"closing_radius_mm": "{CANARY}"}}',
        f'{{"series": {{"{CANARY}": 1}}}}',
        f"{CANARY}",
    ):
        body = form([("volume", head(30.0)), ("parameters", parameters.encode())])
        yield "POST", "/v1/cases", body, {"Content-Type": FORM}
        yield "PUT", f"{case}/mask?mask={CANARY}", None, {}
        yield "PUT", f"{case}/mask?{CANARY}=1", None, {}
    yield "POST", "/v1/cases", form([(CANARY, b"x")]), {"Content-Type": FORM}
    yield "POST", "/v1/cases", form([("volume", CANARY.encode() * 100)]), {"Content-Type": FORM}
    yield "POST", "/v1/cases", b"x", {"Content-Type": f"text/{CANARY}"}
    yield "GET", case, None, {"X-Request-Id": f"{CANARY}-1"}
    yield "GET", case, None, {"X-Request-Id": f"{CANARY} 1"}
    yield "GET", case, None, {"Authorization": f"Bearer {CANARY}"}
    yield "GET", f"{case}/mesh", None, {"Accept": f"text/{CANARY}"}
    yield "GET", case, None, {"Host": f"{CANARY}.example.org"}
    yield "POST", "/v1/cases", None, {"Origin": f"http://{CANARY}.example.org"}
    yield "GET", f"{case}/mesh", None, {"Range": f"bytes={CANARY}"}
    yield CANARY.upper(), case, None, {}


def others_may(path):
    return bool(stat.S_IMODE(os.stat(path).st_mode) & 0o077)


def main():
    report = Report("what others can read")
    with tempfile.TemporaryDirectory(prefix="isocortex-fault-") as folder:
        # A folder that was made by hand, as `mkdir` makes it.
        data = os.path.join(folder, "data")
        os.mkdir(data, 0o755)
        os.chmod(data, 0o755)
        os.umask(0o022)
        with Server(data=data) as server:
            case = server.prepared(head(8.0))
            readable = [os.path.relpath(os.path.join(root, name), folder)
                        for root, folders, names in os.walk(folder)
                        for name in folders + names if others_may(os.path.join(root, name))]
            report.expect("nothing in the data folder is readable by others", not readable, f"{len(readable)}: {readable[:4]}")
            repeating, asked = [], 0
            for method, address, body, headers in requests(case):
                status, got, answer = server.ask(method, address, body, headers)
                asked += 1
                where = [k for k, v in got.items() if CANARY.lower() in v.lower() and k != "x-request-id"]
                if status >= 400 and (CANARY.lower() in answer.decode(errors="replace").lower() or where):
                    repeating.append(f"{method} {address.replace(case, '…')} {body[:60] if body and len(body) < 200 else ''}")
            report.figure("requests with a canary", asked)
            report.expect("no error repeats it", not repeating, f"{len(repeating)}: {repeating[:6]}")
            lines = [line for line in server.log().splitlines() if CANARY.lower() in line.lower()]
            report.expect("no line of the log repeats it", not lines, f"{len(lines)}: {lines[:2]}")
            identifier = case.rsplit("/", 1)[1]
            with_id = [line for line in server.log().splitlines() if identifier in line]
            report.expect("no line of the log holds the case's id", not with_id, f"{len(with_id)}: {with_id[:1]}")
        token = os.path.join(folder, "token")
        with open(token, "w") as file:
            file.write("0123456789abcdef-token\n")
        os.chmod(token, 0o644)
        try:
            with Server(arguments=["--token-file", token]) as server:
                told = "token" in server.log().lower()
                report.expect("a token's file that others can read is refused, or mended and told", told and not others_may(token))
        except RuntimeError as refusal:
            report.expect("a token's file that others can read is refused with words", "token" in str(refusal))
    report.end()


main()
