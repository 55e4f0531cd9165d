"""Apache with docs/sign-in/apache.conf in front of a server: people sign in by OpenID Connect at npm's oidc-provider.

Whoever has signed in is known by name, with the role of the group; others are nobody, whatever headers they send. Apache and
mod_auth_openidc are Debian's, and oidc-provider is npm's; both come into a folder of the attack's own.
"""

import html.parser
import http.client
import http.cookiejar
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.parse
import urllib.request

from attack import Report, Server, skip
from cluster import free_ports
from debian import unpacked

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
PACKAGES = ["apache2-bin", "libapache2-mod-auth-openidc", "libapr1", "libaprutil1", "libcjose0", "libcurl4", "libhiredis0.14", "libjansson4"]
PROVIDER = "oidc-provider@9.13.3"
TOKEN = "a-token-of-this-attack"

# Its own pages take any name and any password.
ISSUER = """
import Provider from "oidc-provider";
const [address, site] = process.argv.slice(2);
const groups = { ana: ["staff", "radiology-readers"], guest: [] };
const provider = new Provider(address, {
  clients: [{
    client_id: "isocortex", client_secret: "a-secret-of-the-client", grant_types: ["authorization_code"],
    redirect_uris: [`${site}/oauth2/callback`], post_logout_redirect_uris: [`${site}/`],
  }],
  claims: { openid: ["sub"], profile: ["preferred_username"], groups: ["groups"] },
  cookies: { keys: ["a key of this attack"] },
  findAccount: (_context, accountId) => ({
    accountId, claims: () => ({ sub: `id-of-${accountId}`, preferred_username: accountId, groups: groups[accountId] }),
  }),
});
provider.listen(Number(new URL(address).port), "127.0.0.1");
"""

# What Debian's /etc/apache2/apache2.conf and its links to modules say.
APACHE_CONF = """
ServerRoot {folder}
PidFile {folder}/apache.pid
ErrorLog {folder}/apache.log
Listen 127.0.0.1:{port}
User www-data
Group www-data
{modules}
{site}
"""
LOADED = ["mpm_event", "authn_core", "authz_core", "authz_user", "headers", "proxy", "proxy_http", "auth_openidc"]


def until_it_answers(process, port, log):
    end = time.monotonic() + 60
    while True:
        try:
            http.client.HTTPConnection("127.0.0.1", port, timeout=5).connect()
            return
        except OSError:
            with open(log) as file:
                assert time.monotonic() < end and process.poll() is None, file.read()[-2000:]
            time.sleep(0.1)


class Running:
    """A program that ends with the attack. `with Running(…):` waits until it listens."""

    def __init__(self, command, folder, port, log, environment=None):
        self.command, self.folder, self.port, self.log = command, folder, port, f"{folder}/{log}"
        self.environment = environment

    def __enter__(self):
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(
                self.command, cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        until_it_answers(self.process, self.port, self.log)
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(30)


def issuer(folder, port, site):
    """oidc-provider, installed from npm."""
    if not shutil.which("npm"):
        skip("there is no npm")
    npm = ["npm", "install", "--prefix", folder, "--no-audit", "--no-fund", "--ignore-scripts", PROVIDER]
    done = subprocess.run(npm, capture_output=True, text=True)
    if done.returncode:
        skip(f"{PROVIDER} cannot be installed from npm: {(done.stderr.strip().splitlines() or ['no reason'])[-1]}")
    with open(f"{folder}/issuer.mjs", "w") as file:
        file.write(ISSUER)
    return Running(["node", "issuer.mjs", f"http://127.0.0.1:{port}", site], folder, port, "issuer.log")


def apache(folder, port, issuer_port, socket):
    """Apache with the site of docs/, without TLS and at ports of this attack."""
    unpacking = f"{folder}/debian"
    environment = unpacked(unpacking, *PACKAGES)
    with open(f"{folder}/oidc-secrets.conf", "w") as file:
        file.write("OIDCClientSecret a-secret-of-the-client\nOIDCCryptoPassphrase a-passphrase-of-this-attack\n")
    with open(f"{ROOT}/docs/sign-in/apache.conf") as file:
        site = file.read()
    tls = site[site.index("    SSLEngine on") : site.index("    # Register a client")]
    for what, instead in [
        ("<VirtualHost *:443>", f"<VirtualHost 127.0.0.1:{port}>"),
        ("isocortex.hospital.example", "127.0.0.1"),
        (tls, ""),
        ("https://id.hospital.example/realms/hospital", f"http://127.0.0.1:{issuer_port}"),
        ("/etc/isocortex", folder),
        ("/run/isocortex/proxy.sock", socket),
    ]:
        assert what in site, f"docs/sign-in/apache.conf has no {what!r}"
        site = site.replace(what, instead)
    modules = "\n".join(f"LoadModule {name}_module {unpacking}/usr/lib/apache2/modules/mod_{name}.so" for name in LOADED)
    with open(f"{folder}/apache.conf", "w") as file:
        file.write(APACHE_CONF.format(**locals()))
    command = [f"{unpacking}/usr/sbin/apache2", "-f", f"{folder}/apache.conf", "-DFOREGROUND"]
    return Running(command, folder, port, "apache.log", environment)


class Form(html.parser.HTMLParser):
    """The first form of a page: where it goes, and its fields."""

    def __init__(self, page):
        super().__init__()
        self.action, self.fields = None, {}
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        of = dict(attributes)
        if tag == "form" and self.action is None:
            self.action = of["action"]
        if tag in ("input", "button") and "name" in of:
            self.fields[of["name"]] = of.get("value", "")


class Browser:
    """Cookies, and the way through redirections."""

    def __init__(self, site):
        self.site = site
        self.cookies = http.cookiejar.CookieJar()
        self.opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(self.cookies))

    def ask(self, address, data=None, **headers):
        """Status, last address and body of an answer."""
        # Apache leads those alone to the issuer who accept a page.
        names = {"Accept": "text/html,*/*", **{name.replace("_", "-"): value for name, value in headers.items()}}
        body = data and urllib.parse.urlencode(data).encode()
        request = urllib.request.Request(urllib.parse.urljoin(self.site, address), body, names)
        try:
            answer = self.opener.open(request, timeout=30)
        except urllib.error.HTTPError as error:
            answer = error
        with answer:
            return answer.status, answer.url, answer.read().decode()

    def signs_in(self, name, address):
        """Opens a page, fills in what the issuer asks, and returns where that ends."""
        status, at, page = self.ask(address)
        for _ in range(4):
            if at.startswith(f"{self.site}/") or status != 200:
                break
            form = Form(page)
            answers = {"login": name, "password": "any"}
            status, at, page = self.ask(urllib.parse.urljoin(at, form.action), {**form.fields, **{
                field: answers[field] for field in form.fields if field in answers
            }})
        return status, at

    def session(self, **headers):
        status, _, body = self.ask("/v1/session", **headers)
        return status, json.loads(body)


def check(report, server, site, sign_out):
    nobody = Browser(site)
    status, _ = nobody.session()
    report.expect("without a session, what a page asks for is answered 401", status == 401, status)
    status, seen = nobody.session(X_Remote_User="ana", X_Remote_Groups="radiology-readers")
    report.expect("headers that a client sends through Apache sign nobody in", status == 401, (status, seen.get("name")))
    status, seen = nobody.session(Authorization=f"Bearer {TOKEN}")
    report.expect("a program with a token comes through Apache", (status, seen.get("name")) == (200, "token"), status)

    ana = Browser(site)
    status, at = ana.signs_in("ana", "/launch?studyUID=1.2.3.4")
    report.expect("whoever signs in comes back to the page that was opened", (status, at) == (200, f"{site}/launch?studyUID=1.2.3.4"), at)
    status, seen = ana.session()
    expected = {"name": "proxy:ana", "scopes": ["read", "write", "results"], "sign_out": sign_out}
    report.expect("the server knows the user, with the role of the group", (status, seen) == (200, expected), seen)
    status, seen = ana.session(X_Remote_User="boss", X_Remote_Groups="administrators")
    report.expect("headers that the user adds change nothing", (status, seen) == (200, expected), seen)
    how = json.loads(ana.ask("/sign-in")[2])
    report.expect("the page learns that a proxy signs people in", how == {"by_proxy": True}, how)

    guest = Browser(site)
    status, at = guest.signs_in("guest", "/")
    report.expect("somebody without a group signs in too", (status, at) == (200, f"{site}/"), at)
    status, seen = guest.session()
    report.expect("and may do nothing: 403 missing-scope", status == 403 and seen["type"].endswith("missing-scope"), seen)

    forged = {"X-Remote-User": "ana", "X-Remote-Groups": "radiology-readers"}
    status, _, _ = server.ask("GET", "/v1/session", headers=forged)
    report.expect("the same headers from another address are refused", status == 401, status)

    status, at, page = ana.ask(sign_out)
    form = Form(page)
    ana.ask(urllib.parse.urljoin(at, form.action), {**form.fields, "logout": "yes"})
    status, _ = ana.session()
    report.expect("whoever has signed out is nobody", status == 401, status)
    status, at, _ = ana.ask("/")
    report.expect("and is asked by the issuer again", "/interaction/" in at, at)


def main():
    report = Report("people sign in by Apache and OpenID Connect")
    # Apache's workers are another user, who may pass.
    folder = tempfile.mkdtemp(prefix="isocortex-sign-in-")
    os.chmod(folder, 0o755)
    try:
        port, issuer_port = free_ports(2)
        site, socket = f"http://127.0.0.1:{port}", f"{folder}/proxy.sock"
        sign_out = f"/oauth2/callback?logout={urllib.parse.quote(site + '/', safe='')}"
        settings = f"""
[http]
token = "{TOKEN}"
[proxy]
user_header = "X-Remote-User"
groups_header = "X-Remote-Groups"
sign_out = "{sign_out}"
socket = "{socket}"
[proxy.roles]
"radiology-readers" = "editor"
"administrators" = "admin"
"""
        with issuer(folder, issuer_port, site), Server(settings=settings) as server:
            if os.geteuid() == 0:
                shutil.chown(socket, group="www-data")
            with apache(folder, port, issuer_port, socket):
                check(report, server, site, sign_out)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    report.end()


main()
