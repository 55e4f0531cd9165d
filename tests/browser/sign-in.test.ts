// Signing in by a real issuer: to the case that was meant, again without a loss, and out.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import type { Browser, Locator, Page } from "playwright-core";

import { violations } from "./axe.ts";
import { AUDIENCE, type Issuer, startIssuer } from "./issuer.ts";
import { brainMask, markedVolume } from "./phantom.ts";
import {
  type Server,
  type Stage,
  type Watched,
  configured,
  findingsOf,
  keep,
  openPage,
  shown,
  skip,
  startStage,
  until,
} from "./support.ts";
import { sendCase } from "./uploads.ts";

const TOKEN = { authorization: "Bearer a-token-of-the-tests" };

let stage: Stage | undefined;
let issuer: Issuer;
let server: Server;
let browser: Browser;
let id: string;
/** What the server has written. */
const log: string[] = [];

before(
  async () => {
    if (skip) return;
    issuer = await startIssuer();
    const lines = [
      `log = "debug"`,
      `[http]`,
      `token = "${TOKEN.authorization.slice(7)}"`,
      `[oidc]`,
      `issuer = "${issuer.address}"`,
      `audience = "${AUDIENCE}"`,
      `client_id = "page"`,
      `roles_claim = "groups"`,
      `[oidc.roles]`,
      `readers = "editor"`,
      `[oidc.parameters]`,
      `resource = "${AUDIENCE}"`,
    ];
    stage = await startStage("serve", (folder) => configured(folder, lines.join("\n")));
    ({ server, browser } = stage);
    for (const stream of [server.child.stdout, server.child.stderr])
      stream?.on("data", (piece: Buffer) => log.push(String(piece)));
    await issuer.serve(server.address);
    id = await sendCase(server, { volume: markedVolume(), mask: brainMask() }, TOKEN);
  },
  { timeout: 600_000 },
);

after(async () => {
  await stage?.end();
  await issuer?.stop();
});

/** A page whose issuer needs no fonts of others. */
async function open(locale = "en-GB"): Promise<Watched> {
  const watched = await openPage(browser, { locale });
  await watched.context.route("https://fonts.googleapis.com/**", (route) => route.fulfill({ contentType: "text/css" }));
  return watched;
}

/** Signs in on the pages of the issuer. */
async function signIn(page: Page, name: string): Promise<void> {
  await page.locator("input[name=login]").fill(name);
  await page.locator("input[name=password]").fill("any");
  await page.locator("button[type=submit]").click();
  // The issuer asks whether the page may know this.
  await page.getByRole("button", { name: "Continue" }).click();
}

/** What the tab keeps of the session. */
const session = (page: Page): Promise<Record<string, unknown> | null> =>
  page.evaluate(() => JSON.parse(sessionStorage.getItem("session") ?? "null") as Record<string, unknown> | null);

/** Lets the token end while the page is loaded again. The page before must not renew it, because it would lose the answer. */
async function reloadAfterEnd(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const kept = JSON.parse(sessionStorage.getItem("session") ?? "null") as object | null;
    if (!kept || sessionStorage.getItem("has-ended")) return;
    sessionStorage.setItem("has-ended", "yes");
    sessionStorage.setItem("session", JSON.stringify({ ...kept, ends: 0 }));
  });
  await page.reload();
}

/** Ends the session for good and presses a button, before the page can ask the server for anything else. */
const endAndPress = (button: Locator): Promise<void> =>
  button.evaluate((pressed: HTMLElement) => {
    const kept = JSON.parse(sessionStorage.getItem("session") ?? "{}") as object;
    sessionStorage.setItem("session", JSON.stringify({ ...kept, ends: 1, access: "a.b.c", refresh: "" }));
    pressed.click();
  });

const who = (page: Page): Promise<string> => page.locator("#who").innerText();

/** What the browser says of answers that are refusals on purpose. */
const unexpected = (troubles: readonly string[]): readonly string[] =>
  troubles.filter((trouble) => !/status of 40[13]/.test(trouble));

test("whoever follows an address signs in first, and stands where it leads", { skip }, async () => {
  const { page, context, troubles } = await open();
  const addresses: string[] = [];
  page.on("request", (request) => addresses.push(request.url()));
  await page.goto(`${server.address}#${id}&d=12`);
  await signIn(page, "silva");
  await shown(page);
  assert.match(new URL(page.url()).hash, new RegExp(`^#${id}&.*d=12`));
  await page.locator("#who").waitFor();
  assert.equal(await who(page), "Dr. silva");
  await keep(page, "signed-in");
  await page.locator("#who").click();
  await page.locator("#holder").waitFor();
  await keep(page, "signed-in-who");
  assert.deepEqual(await violations(page), []);
  assert.match(await page.locator("dialog.holder").innerText(), /Dr\. silva[^]*read, write, results/);

  // Tokens and codes are in no address that a server or the history sees, and in nothing that outlives the tab.
  const { access, refresh } = (await session(page)) as { access: string; refresh: string };
  assert.equal(access.split(".").length, 3);
  for (const secret of [access, refresh]) assert.ok(!addresses.some((address) => address.includes(secret)));
  const own = addresses.filter((address) => address.startsWith(server.address));
  assert.ok(!own.some((address) => /[?&](code|state)=/.test(address)), own.join("\n"));
  assert.ok(!(await page.evaluate(() => JSON.stringify({ ...localStorage }))).includes(access));
  const written = log.join("");
  assert.match(written, /answered/);
  for (const part of access.split(".")) assert.ok(!written.includes(part));

  // Reloading asks nobody, nor does another page of the same tab, with its frames.
  await page.reload();
  await shown(page);
  await page.getByRole("link", { name: "Two cases" }).click();
  await page.frameLocator("iframe").locator("#surface[data-drawn=true]").waitFor();
  assert.deepEqual(unexpected(troubles), []);
  await context.close();
});

test("a launch address survives the sign-in, and an answer counts once", { skip }, async () => {
  const { page, context, troubles } = await open();
  const asked: unknown[] = [];
  page.on("request", (request) => {
    if (request.url().endsWith("/v1/launch")) asked.push(request.postDataJSON());
  });
  await page.goto(new URL("launch?studyUID=1.2.3.4&requestType=STUDY", server.address).href);
  let answer = "";
  page.on("framenavigated", (frame) => {
    if (frame.url().includes("/signed-in#")) answer = frame.url();
  });
  await signIn(page, "silva");
  await page.waitForURL(new URL("launch", server.address).href);
  await page.locator("#message").waitFor();
  await until(
    async () => asked.length,
    (count) => count >= 2,
  );
  assert.deepEqual(asked.at(-1), { query: "?studyUID=1.2.3.4&requestType=STUDY" });
  assert.doesNotMatch(await page.evaluate(() => JSON.stringify({ ...sessionStorage })), /1\.2\.3\.4|signing-in/);

  // Somebody else's answer, or the same one again, signs nobody in.
  const before = await session(page);
  assert.match(answer, /code=/);
  for (const replayed of [answer, new URL("signed-in#code=x&state=y", server.address).href]) {
    await page.goto("about:blank");
    await page.goto(replayed);
    await page.getByText("This sign-in was not begun in this browser").waitFor();
    assert.doesNotMatch(page.url(), /code=/);
    assert.deepEqual(await session(page), before);
  }
  assert.deepEqual(unexpected(troubles), []);
  await context.close();
});

test("a session is renewed silently, and what is written after its end is kept", { skip }, async () => {
  const { page, context, troubles } = await open();
  await page.goto(`${server.address}#${id}&r=mesh&d=12&l=slices&x=-38,0,0`);
  await signIn(page, "silva");
  await shown(page);
  await page.waitForSelector(".findings", { state: "attached" });
  const first = await session(page);
  await reloadAfterEnd(page);
  await shown(page);
  await page.waitForSelector(".findings", { state: "attached" });
  const renewed = await session(page);
  assert.equal(renewed?.subject, "silva");
  assert.notEqual(renewed.access, first?.access);
  assert.equal(await page.locator("dialog").count(), 0);

  // The session ends for good, while a finding is written.
  await endAndPress(page.getByRole("button", { name: "Mark the cross as a finding", disabled: false }));
  await page.locator("dialog.ask-sign-in").waitFor();
  await keep(page, "session-ended");
  assert.deepEqual(await violations(page), []);
  assert.match(await page.locator("dialog.ask-sign-in").innerText(), /Your session has ended/);
  const opened = context.waitForEvent("page");
  await page.locator("#sign-in").click();
  const beside = await opened;
  await page.locator("dialog.ask-sign-in").waitFor({ state: "detached" });
  const list = () => findingsOf(server, id, TOKEN);
  assert.equal((await until(list, ({ length }) => length === 1)).length, 1);
  assert.equal(await page.locator(".finding-label").count(), 1);
  // The issuer knew who it was, and asked nothing.
  assert.equal((await session(page))?.subject, "silva");
  if (!beside.isClosed()) await beside.close();
  assert.deepEqual(unexpected(troubles), []);
  await context.close();
});

test("whoever has no role sees nothing, and whoever signs out is out", { skip }, async () => {
  const { page, context } = await open("pt-BR");
  await page.goto(server.address);
  await signIn(page, "guest");
  await page.getByText("O seu acesso não permite isto").first().waitFor();
  await page.locator("#who").click();
  await page.locator("#holder").waitFor();
  await keep(page, "no-role");
  assert.match(await page.locator("dialog.holder").innerText(), /Dr\. guest[^]*não permite isto/);
  await page.locator("#sign-out").click();
  // The issuer asks whether it is meant.
  await page.locator("button[name=logout]").click();
  await page.locator("dialog.ask-sign-in").waitFor();
  await keep(page, "signed-out");
  assert.equal(await session(page), null);
  assert.equal(page.url(), new URL("/", server.address).href);
  // Signing in is a click away, and asks for a name again.
  await page.locator("#sign-in").click();
  await signIn(page, "silva");
  await page.locator("#who").waitFor();
  assert.equal(await who(page), "Dr. silva");
  await context.close();
});
