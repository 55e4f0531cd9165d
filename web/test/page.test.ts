import assert from "node:assert/strict";
import { afterEach, before, test } from "node:test";

import { Problem, allCases, getCase, onReach, onTokenWanted, problemFrom } from "../src/base/api.ts";
import { caseIdentity, caseStatus, reasonWords, titleParts } from "../src/base/case-words.ts";
import type { Quality } from "../src/model/case.ts";
import { doubtsOf } from "../src/model/quality.ts";
import { pathOf, reachOfChart, ticks } from "../src/page/chart.tsx";
import { type Words, intensity, languageFor, number, numberUpTo, readNumber, speak, t } from "../src/base/i18n.ts";
import { isOfOther } from "../src/page/findings-files.tsx";
import { parsed } from "../src/model/text.ts";
import { readPreferences } from "../src/store/preferences.ts";
import { problemWords } from "../src/base/problem-words.ts";
import { ofSubject, partName, sequenceOf, sortFiles, uploadName } from "../src/page/upload-files.ts";
import english from "../src/words.en.json";
import portuguese from "../src/words.pt-BR.json";
import { SHOWN } from "./shown.ts";
import { sources } from "./sources.ts";

const realFetch = globalThis.fetch;
before(() => speak("en", english));
afterEach(() => {
  globalThis.fetch = realFetch;
  speak("en", english);
});

const json = (status: number, body: unknown): Response =>
  new Response(JSON.stringify(body), { status, headers: { "content-type": "application/problem+json" } });
const headers = (type: string): Headers => new Headers({ "content-type": type });

test("a long title is cut in its middle and keeps the date at its end", () => {
  assert.deepEqual(titleParts("a short title"), ["a short title", ""]);
  assert.deepEqual(titleParts("anat-T1w · 2013-07-17"), ["anat-T1w · ", "2013-07-17"]);
});

test("a file with the findings of another case is told from those of this one and of its versions", () => {
  const one = { ...SHOWN, id: "01234567".repeat(4), previous: "89abcdef".repeat(4), next: ["aaaa0000".repeat(4)] };
  for (const own of ["01234567", "89abcdef", "aaaa0000"])
    assert.ok(!isOfOther(`isocortex-${own}-findings (1).json`, one), own);
  assert.ok(isOfOther("isocortex-76543210-findings.json", one));
  assert.ok(!isOfOther("my-list.json", one));
});

test("that left and right are in doubt is said first, and not as an error of the mask", () => {
  const quality = (state: "ok" | "review" | "failed", ...codes: string[]): Quality => ({
    state,
    method: "network",
    reasons: codes.map((code) => `about ${code}`),
    reason_codes: codes,
  });
  assert.deepEqual(doubtsOf(quality("ok")), []);
  assert.deepEqual(doubtsOf(quality("review", "axes-corrected")), ["sides"]);
  assert.deepEqual(doubtsOf(quality("review", "axes-corrected", "axes-assumed")), ["sides"]);
  assert.deepEqual(doubtsOf(quality("review", "mask-thin", "axes-corrected")), ["sides", "review"]);
  assert.deepEqual(doubtsOf(quality("failed", "axes-corrected")), ["sides", "failed"]);
  assert.deepEqual(doubtsOf(quality("review", "mask-thin")), ["review"]);
});

test("a profile is drawn down to 30 mm, or to the depth that is shown", () => {
  assert.deepEqual([0, 12, 30, 30.1, 38, 40].map(reachOfChart), [30, 30, 30, 35, 40, 40]);
});

test("both languages have the same words, with the same values in them", () => {
  assert.deepEqual(Object.keys(portuguese), Object.keys(english));
  const values = (text: string): string[] => [...text.matchAll(/\{(\w+)\}/g)].map(([, name]) => name ?? "").sort();
  for (const [key, text] of Object.entries(english)) {
    const other = portuguese[key as keyof typeof english];
    assert.deepEqual(values(other), values(text), key);
    assert.notEqual(other.trim(), "", key);
    assert.equal(other.split("|").length, text.split("|").length, key);
    assert.ok(!`${text}${other}`.includes("`"), key);
  }
});

test("every word is used, and no word that is used is missing", () => {
  const source = sources()
    .map(({ text }) => text)
    .join("\n");
  // Keys that are put together from a part and a name count as used by their first part.
  const used = (key: string): boolean =>
    source.includes(`"${key}"`) ||
    source.includes(`\`${key.slice(0, key.indexOf(".") + 1)}\${`) ||
    source.includes(`\`${key}\``) ||
    /^(help|theme|wheel|drag|shortcuts|linked_zoom|sign)\./.test(key);
  for (const key of Object.keys(english)) assert.ok(used(key), key);
});

test("numbers are written as the language does", () => {
  assert.equal(number(-0.04, 1), "0.0");
  assert.equal(intensity(1234.5), "1,235");
  speak("pt-BR", portuguese as Words);
  assert.equal(number(8.5, 1), "8,5");
  assert.deepEqual([numberUpTo(14.5, 2), numberUpTo(10, 2), numberUpTo(0.999_98, 2)], ["14,5", "10", "1"]);
  assert.deepEqual([readNumber(" 14,5 "), readNumber("14.5"), readNumber(""), readNumber("x")], [14.5, 14.5, NaN, NaN]);
  assert.equal(t("depth.said", { depth: number(8.5, 1) }), "Profundidade de 8,5 milímetros");
});

test("a browser's wish decides the language", () => {
  assert.equal(languageFor(["de-DE", "pt-PT", "en"]), "pt-BR");
  assert.equal(languageFor(["en-GB", "pt-BR"]), "en");
  assert.equal(languageFor(["fr"]), "en");
});

test("a problem's detail becomes a sentence; a body that is no JSON is not shown", () => {
  const told = problemFrom(
    422,
    headers("application/problem+json"),
    '{"type":"urn:isocortex:problem:mask-empty","detail":"the mask is empty"}',
  );
  assert.equal(problemWords(told), "The mask is empty.");
  assert.equal(told.kind, "mask-empty");
  // What the server marks as code, a page quotes.
  const coded = JSON.stringify({ type: "urn:isocortex:problem:x", detail: "state its `contrast`" });
  const marked = problemFrom(400, headers("application/problem+json"), coded);
  assert.equal(problemWords(marked), "State its “contrast”.");
  const untold = problemFrom(502, headers("text/html"), "<html>proxy at 10.0.0.1</html>");
  assert.equal(problemWords(untold), "The server answered with status 502.");
  assert.equal(
    problemWords(problemFrom(500, headers("application/json"), "{")),
    "The server answered with status 500.",
  );
  speak("pt-BR", portuguese as Words);
  assert.equal(problemWords(told), "A máscara está vazia.");
  // Numbers are in the server's sentence alone.
  const missing = "slices 12 and 13 of 192 are missing";
  const numbered = problemFrom(
    422,
    headers("application/problem+json"),
    JSON.stringify({ type: "urn:isocortex:problem:dicom-slices-missing", detail: missing }),
  );
  assert.match(problemWords(numbered), /^Faltam cortes .* \(O servidor respondeu, em inglês: Slices 12 and 13 of 192/);
});

test("a token is asked for once, however many requests are refused", async () => {
  let asked = 0;
  const sent: (string | null)[] = [];
  globalThis.fetch = async (_input, options) => {
    const authorization = new Headers(options?.headers).get("authorization");
    sent.push(authorization);
    return authorization === "Bearer right" ? json(200, { cases: [] }) : json(401, { detail: "a token is wanted" });
  };
  onTokenWanted(async () => {
    asked += 1;
    return "right";
  });
  await Promise.all([allCases(), allCases(), getCase("x")]);
  assert.equal(asked, 1);
  assert.ok(sent.includes("Bearer right"));
});

test("a server that cannot be reached is a problem of its own", async () => {
  const heard: boolean[] = [];
  const back = new Promise<void>((resolve) =>
    onReach((reachable) => {
      heard.push(reachable);
      if (reachable) resolve();
    }),
  );
  globalThis.fetch = async () => Promise.reject(new TypeError("no route to 10.1.2.3"));
  await assert.rejects(allCases(), (problem: unknown) => problem instanceof Problem && problem.kind === "unreachable");
  globalThis.fetch = async () => json(200, {});
  await back;
  assert.deepEqual(heard, [false, true]);
});

test("a case says what it is at", () => {
  const { id, name, created_at, kept } = SHOWN;
  assert.equal(
    caseStatus({ id, name, created_at, kept, state: "preparing", progress: { stage: "forest", fraction: 0.414 } }),
    "Growing the forest · 41 %",
  );
  assert.equal(
    caseStatus({ id, name, created_at, kept, state: "preparing", progress: { stage: "new step", fraction: 0.5 } }),
    "Preparing · 50 %",
  );
  assert.equal(
    caseStatus({ id, name, created_at, kept, state: "failed", error: { type: "urn:x:other", detail: "it is odd" } }),
    "It is odd.",
  );
});

test("a case in the list tells its series, its voxels and, of DICOM files, its sequence", () => {
  assert.equal(caseStatus(SHOWN), "1 × 1 × 2 mm");
  const volume = { ...SHOWN.volume, series_number: 4, sequence: "*tfl3d1, TR 2300" };
  assert.equal(caseStatus({ ...SHOWN, volume }), "Series 4 · 1 × 1 × 2 mm · *tfl3d1, TR 2300");
});

test("the reasons of a verdict are the server's sentences, or the page's in another language", () => {
  const quality = {
    state: "review",
    method: "supplied",
    reasons: ["the mask has 400 ml", "it is odd"],
    reason_codes: ["mask-volume", "a-code-of-tomorrow"],
  } as const;
  assert.deepEqual(reasonWords(quality), ["The mask has 400 ml.", "It is odd."]);
  speak("pt-BR", portuguese as Words);
  assert.deepEqual(reasonWords(quality), ["O volume da máscara não é o de um encéfalo.", "It is odd."]);
});

const file = (name: string, size = 1000): { name: string; size: number } => ({ name, size });

test("a case is told from all others by label, day and the first digits of its id", () => {
  assert.equal(caseIdentity(SHOWN), "A case · added Jan 1, 2026 · 01234567");
  assert.equal(caseIdentity({ ...SHOWN, name: null }), "Case 01234567 · added Jan 1, 2026");
});

test("files are sorted by what they are", () => {
  const [head, mask] = [file("head.nii.gz", 900), file("head_mask.nii.gz", 5000)];
  assert.deepEqual(sortFiles([mask, head], null), { volume: head, mask, dicom: [], layers: [], trouble: null });
  const [large, small] = [file("a.nii", 900), file("b.nii", 10)];
  assert.deepEqual(sortFiles([small, large], null), {
    volume: large,
    mask: small,
    dicom: [],
    layers: [],
    trouble: null,
  });
  assert.deepEqual(sortFiles([head], mask), { volume: head, mask, dicom: [], layers: [], trouble: null });
  const zip = file("series.ZIP");
  assert.deepEqual(sortFiles([zip, mask], null), { volume: zip, mask, dicom: [], layers: [], trouble: null });
  const series = [file("IM0001"), file("IM0002.dcm"), file("IM0003")];
  assert.deepEqual(
    sortFiles([...series, file("DICOMDIR"), file("report.pdf"), file(".DS_Store"), file("empty", 0)], null).dicom,
    series,
  );
  const subject = ["mri/T1.mgz", "mri/brainmask.mgz", "surf/lh.white", "surf/rh.thickness", "label/lh.aparc.annot"];
  const folder = [...subject, "mri/ribbon.mgz", "surf/lh.white.H", "surf/lh.sphere", "scripts/recon-all.log"].map(
    (path) => {
      const { name } = ofSubject(new File(["x"], path.replace(/.*\//, "")), `/Smith/${path}`);
      return file(name);
    },
  );
  const { dicom, volume: none } = sortFiles(folder, null);
  assert.deepEqual([dicom.map(({ name }, index) => partName(name, index)), none], [subject, null]);
  assert.equal(partName("Smith.IMA", 3), "4.dcm");
  assert.equal(sequenceOf(file("/CT study/mri/T1.mgz"))?.name, "T1");
  const two = sortFiles([...folder, file("/fsaverage/surf/lh.white")], null);
  assert.deepEqual([two.trouble, two.dicom], ["upload.too-many", []]);
  assert.equal(sortFiles([], null).trouble, "upload.nothing");
  assert.equal(sortFiles([head, large, small], null).trouble, "upload.too-many");
  assert.equal(sortFiles([zip, file("b.zip")], null).trouble, "upload.too-many");
});

test("a file is sent under a name that tells nothing", () => {
  assert.equal(uploadName("volume", "DOE^JANE 1970.NII.GZ"), "volume.nii.gz");
  assert.equal(uploadName("mask", "x.nii"), "mask.nii");
  assert.equal(uploadName("volume", "Jane.Doe"), "volume");
});

test("preferences that are damaged are as at first", () => {
  const first = readPreferences(null, ["en"]);
  assert.deepEqual(first, {
    language: "en",
    theme: "dark",
    drag: "up-darker",
    wheel: "zoom",
    shortcuts: true,
    knows_depth: false,
    linked_zoom: true,
    list: false,
    panel: true,
    task: "read",
    unfolded: ["panel.list", "panel.reading", "panel.point", "panel.layers"],
    protocol: "complete",
    reader: "",
  });
  for (const text of [
    "",
    "{",
    "[]",
    "null",
    "7",
    '{"theme":"pink","language":"xx","wheel":3,"unfolded":1,"protocol":"toString"}',
  ])
    assert.deepEqual(readPreferences(parsed(text), ["en"]), first, text);
  assert.equal(readPreferences({ theme: "light" }, ["en"]).theme, "light");
});

test("a chart's ticks are round, and a curve is interrupted where it has no value", () => {
  assert.deepEqual(ticks(0, 40, 5), [0, 10, 20, 30, 40]);
  assert.deepEqual(ticks(3, 3, 4), [3]);
  assert.equal(pathOf([0, 1, 2, 3], [5, NaN, 6, 7]), "M0.0 5.0M2.0 6.0L3.0 7.0");
});
