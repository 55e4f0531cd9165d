// Signing in: what goes to the issuer, and which of its answers count.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { beforeEach, test } from "node:test";

import { type Issuer, forgetSession, keepSession, renewed, session } from "../src/base/session.ts";
import { begin, finish, takeAttempt } from "../src/base/sign-in.ts";

const ISSUER: Issuer = {
  issuer: "https://id.example/site",
  client_id: "page",
  authorization_endpoint: "https://id.example/authorize?tenant=1",
  token_endpoint: "https://id.example/token",
  scope: "openid profile",
  parameters: { resource: "urn:isocortex" },
  names_itself: true,
};

const storage = new Map<string, string>();
let asked: { readonly address: string; readonly body: URLSearchParams }[] = [];
/** What the token endpoint answers, one after the other. */
let answers: { readonly status: number; readonly body: unknown }[] = [];

Object.assign(globalThis, {
  sessionStorage: {
    getItem: (key: string) => storage.get(key) ?? null,
    setItem: (key: string, value: string) => void storage.set(key, value),
    removeItem: (key: string) => void storage.delete(key),
  },
  location: { pathname: "/", search: "?renderer=server", hash: "#case&d=8" },
  document: { baseURI: "https://isocortex.example/launch" },
  fetch: async (address: string, { body }: { readonly body: URLSearchParams }) => {
    asked.push({ address, body });
    const next = answers.shift();
    if (!next) throw new TypeError("nobody answers");
    return new Response(JSON.stringify(next.body), { status: next.status });
  },
});
Object.defineProperty(globalThis, "navigator", {
  value: { locks: { request: (_name: string, work: () => Promise<void>) => work() } },
  configurable: true,
});

const token = (claims: unknown): string =>
  ["{}", JSON.stringify(claims), ""].map((part) => Buffer.from(part).toString("base64url")).join(".");

beforeEach(() => {
  storage.clear();
  [asked, answers] = [[], []];
});

test("the issuer gets a digest of the secret, and answers in the fragment", async () => {
  const { attempt, address } = await begin(ISSUER);
  const { origin, searchParams } = new URL(address);
  assert.equal(origin, "https://id.example");
  const expected = {
    tenant: "1",
    resource: "urn:isocortex",
    client_id: "page",
    code_challenge: createHash("sha256").update(attempt.verifier).digest("base64url"),
    code_challenge_method: "S256",
    nonce: attempt.nonce,
    redirect_uri: "https://isocortex.example/signed-in",
    response_mode: "fragment",
    response_type: "code",
    scope: "openid profile",
    state: attempt.state,
  };
  assert.deepEqual(Object.fromEntries(searchParams), expected);
  assert.ok(!address.includes(attempt.verifier));
  assert.equal(attempt.back, "/?renderer=server#case&d=8");
  const other = await begin(ISSUER);
  for (const key of ["state", "nonce", "verifier"] as const) assert.notEqual(other.attempt[key], attempt[key]);
});

test("an attempt is answered once, and by an answer to it alone", async () => {
  const { attempt } = await begin(ISSUER);
  storage.set("signing-in", JSON.stringify(attempt));
  for (const answer of ["", "code=x", "code=x&state=", "code=x&state=other", "code=x&state=null"])
    assert.equal(takeAttempt(new URLSearchParams(answer)), null);
  const answer = new URLSearchParams({ code: "x", state: attempt.state });
  assert.deepEqual(takeAttempt(answer), attempt);
  assert.equal(takeAttempt(answer), null);
});

test("an answer counts if it is of the issuer, and its ID token is for this attempt", async () => {
  const { attempt } = await begin(ISSUER);
  const answer = (changes: Record<string, string>): URLSearchParams =>
    new URLSearchParams({ code: "c", state: attempt.state, iss: ISSUER.issuer, ...changes });
  const claims = { iss: ISSUER.issuer, aud: "page", sub: "u-1", nonce: attempt.nonce, name: "Ana Silvã" };
  const tokens = { access_token: "a.b.c", refresh_token: "r", expires_in: 300 };
  answers = [{ status: 200, body: { ...tokens, id_token: token(claims) } }];
  const entered = await finish(attempt, answer({}));
  assert.deepEqual(
    [entered.subject, entered.name, entered.access, entered.refresh],
    ["u-1", "Ana Silvã", "a.b.c", "r"],
  );
  assert.deepEqual(Object.fromEntries(asked[0]?.body ?? []), {
    resource: "urn:isocortex",
    client_id: "page",
    grant_type: "authorization_code",
    code: "c",
    code_verifier: attempt.verifier,
    redirect_uri: "https://isocortex.example/signed-in",
  });

  // No code goes to an issuer that has not sent it.
  asked = [];
  await assert.rejects(finish(attempt, answer({ iss: "https://evil.example" })), /wrong_issuer/);
  const unnamed = answer({});
  unnamed.delete("iss");
  await assert.rejects(finish(attempt, unnamed), /wrong_issuer/);
  const refused = new URLSearchParams({ error: "access_denied", state: attempt.state, iss: ISSUER.issuer });
  await assert.rejects(finish(attempt, refused), /access_denied/);
  assert.deepEqual(asked, []);

  for (const change of [
    { nonce: "other" },
    { nonce: undefined },
    { aud: "other" },
    { aud: [] },
    { iss: "x" },
    { sub: 1 },
  ]) {
    answers = [{ status: 200, body: { ...tokens, id_token: token({ ...claims, ...change }) } }];
    await assert.rejects(finish(attempt, answer({})), /wrong_id_token/, JSON.stringify(change));
  }
  answers = [{ status: 400, body: { error: "invalid_grant" } }];
  await assert.rejects(finish(attempt, answer({})), /invalid_grant/);
});

test("a session that ends soon is renewed, and one that cannot be stays until it ends", async () => {
  const kept = { issuer: ISSUER, subject: "u-1", name: "Ana", access: "old", refresh: "r1", ends: Date.now() + 3e5 };
  keepSession(kept);
  await renewed();
  assert.deepEqual(asked, []);
  keepSession({ ...kept, ends: Date.now() + 5000 });
  answers = [{ status: 200, body: { access_token: "new", refresh_token: "r2", expires_in: 300 } }];
  await renewed();
  assert.deepEqual([session()?.access, session()?.refresh], ["new", "r2"]);
  // One that the server calls ended is renewed whatever its clock says; another one than is there was renewed already.
  await renewed("old");
  assert.equal(asked.length, 1);
  answers = [{ status: 200, body: { access_token: "newer" } }];
  await renewed("new");
  assert.deepEqual([session()?.access, session()?.refresh, session()?.ends], ["newer", "r2", Infinity]);
  // An issuer that is away is asked again; one that refuses is not.
  await renewed("newer");
  assert.equal(session()?.refresh, "r2");
  answers = [{ status: 400, body: { error: "invalid_grant" } }];
  await renewed("newer");
  assert.deepEqual([session()?.access, session()?.refresh], ["newer", ""]);
  await renewed("newer");
  assert.equal(asked.length, 4);
  forgetSession();
  assert.equal(session(), null);
  await renewed();
});
