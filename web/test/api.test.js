import assert from "node:assert/strict";
import { afterEach, test } from "node:test";

import { getCase, listCases, onTokenWanted, problemFrom } from "../src/api.js";

const realFetch = globalThis.fetch;
afterEach(() => (globalThis.fetch = realFetch));

const json = (status, body, type = "application/json") =>
  new Response(JSON.stringify(body), { status, headers: { "content-type": type } });

test("a problem's detail becomes a sentence; a body that is no JSON is not shown", () => {
  const told = problemFrom(422, "application/problem+json", '{"title":"Unprocessable","detail":"the mask is empty"}', null);
  assert.equal(told.message, "The mask is empty.");
  const untold = problemFrom(502, "text/html", "<html>proxy at 10.0.0.1</html>", null);
  assert.equal(untold.message, "The server answered with status 502.");
  const broken = problemFrom(500, "application/json", "{", null);
  assert.equal(broken.message, "The server answered with status 500.");
});

test("a busy server's wish when to be asked again is kept", () => {
  assert.equal(problemFrom(503, "application/problem+json", "{}", "3").retryAfter, 3);
  assert.equal(problemFrom(503, "application/problem+json", "{}", null).retryAfter, 0);
});

test("a server that does not answer is a problem in words", async () => {
  globalThis.fetch = async () => {
    throw new TypeError("fetch failed");
  };
  await assert.rejects(listCases(), { message: "The server does not answer." });
});

test("the token is asked for once, sent with every later request, and asked for again when it is refused", async () => {
  const asked = [];
  const tokens = ["wrong", "right"];
  onTokenWanted(async (refused) => {
    asked.push(refused);
    return tokens[asked.length - 1];
  });
  const sent = [];
  globalThis.fetch = async (path, { headers }) => {
    sent.push(headers.authorization);
    return headers.authorization === "Bearer right" ? json(200, { cases: [] }) : json(401, {}, "application/problem+json");
  };
  await Promise.all([listCases(), getCase("0".repeat(32))]);
  assert.deepEqual(asked, [false, true]);
  sent.length = 0;
  await listCases();
  assert.deepEqual(sent, ["Bearer right"]);
});
