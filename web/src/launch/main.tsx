// Opens the case of the study that the address names, says how far it is, or asks which of several is meant.

import { signal } from "@preact/signals";
import { render } from "preact";
import { useLayoutEffect } from "preact/hooks";

import { ask, handOver, post, send } from "../base/api.ts";
import { leaveLaunch, takeChoice } from "../base/launched.ts";
import { type Key, known, numberUpTo, t } from "../base/i18n.ts";
import { dateWords } from "../base/pacs.ts";
import { wait } from "../base/patience.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import { begin } from "../page/begin.ts";
import { Button } from "../page/fields.tsx";

const LOOK_AGAIN_MS = 2000;

/** Whether the page of a case has led back here, to choose another head of the same study. */
let isChoice = false;
/** The query of the address, or the one that was left with the choice. */
let launchQuery = "";

/** A case that the query fits, or a series of another patient that makes none. */
interface Candidate {
  readonly case?: string;
  readonly state: string;
  readonly study_date?: string;
  readonly acquired?: string;
  readonly series: string;
  readonly is_derived: boolean;
  readonly has_contrast: boolean;
  readonly voxel_mm?: readonly number[];
  /** Only if the page shows the patient. */
  readonly patient?: string;
}

/** What there is of a study. */
interface Found {
  readonly state: string;
  readonly case?: string;
  readonly candidates: readonly Candidate[];
  /** Keys of the query that had no effect. */
  readonly ignored: readonly string[];
  readonly reason?: { readonly detail: string };
  readonly nodes: readonly string[];
  readonly study?: string;
  readonly series?: string;
}

interface Retrieval {
  readonly id: string;
  readonly state: "queued" | "running" | "done" | "failed";
  readonly reason?: { readonly detail: string };
}

/** What distinguishes a case from the others; the patient alone if the server names one. */
function wordsOf({ patient, study_date, acquired, series, state, ...facts }: Candidate): string {
  const size = facts.voxel_mm?.map((side) => numberUpTo(side, 2)).join(" × ");
  const stateKey = known(`candidate.${state}`);
  return [
    patient,
    dateWords(study_date ?? acquired),
    series && t("pacs.series", { series }),
    facts.is_derived && t("launch.derived"),
    facts.has_contrast && t("launch.contrast"),
    size && `${size} mm`,
    state !== "ready" && stateKey && t(stateKey),
    facts.case?.slice(0, 8),
  ]
    .filter(Boolean)
    .join(" · ");
}

const message = signal("");
/** What may be done now: a case be opened, or a series be fetched. */
const offered = signal<{ readonly choices: readonly Candidate[]; readonly of: Found | null }>({
  choices: [],
  of: null,
});

function say(key: Key, reason = "", values: Readonly<Record<string, unknown>> = {}): void {
  message.value = `${t(key, values)} ${reason && sentence(reason)}`.trim();
}

const choose = (choices: readonly Candidate[]): void => void (offered.value = { choices, of: null });

/** Does what may go wrong, and says so. */
const attempt = (work: Promise<void>): void =>
  void work.catch((problem: unknown) => (message.value = problemWords(problem)));

/** Looks again and again until there is something to open, or nothing will come. */
async function follow(): Promise<void> {
  for (;;) {
    const found = await post<Found>("v1/launch", { query: launchQuery });
    const reason = found.reason?.detail ?? "";
    if (isChoice && found.candidates.length > 1) {
      say("launch.several");
      return choose(found.candidates);
    }
    switch (found.state) {
      case "ready":
        if (found.ignored.length === 0 && found.case) return open(found.case, found.candidates.length - 1);
        // Perhaps they should have narrowed the search.
        say("launch.ignored", "", { keys: found.ignored.join(", ") });
        return choose(found.candidates);
      case "choice":
        say("launch.choice");
        return choose(found.candidates);
      case "mismatch":
        return say("launch.mismatch");
      case "failed":
        return say("launch.failed", reason);
      case "nothing":
        return say("launch.nothing", reason);
      case "preparing":
      case "receiving":
        say(`launch.${found.state}`);
        break;
      default:
        say("launch.absent");
        return void (offered.value = { choices: [], of: found });
    }
    await wait(LOOK_AGAIN_MS);
  }
}

/**
 * Opens a case; the page takes the token from here, and asks nobody a second time. A page that does not load would leave
 * it there until the tab is closed, so look first.
 */
async function open(id: string, others = 0): Promise<void> {
  await send("./", { cache: "no-cache" });
  handOver();
  if (others > 0) leaveLaunch({ id, others, query: launchQuery });
  location.replace(`./#${id}`);
}

/** Fetches the series from one of the nodes. */
async function fetchFrom(node: string, { study, series }: Found): Promise<void> {
  choose([]);
  say("launch.fetching");
  let retrieval = await post<Retrieval>("v1/retrievals", { node, study, series });
  while (retrieval.state === "queued" || retrieval.state === "running") {
    await wait(LOOK_AGAIN_MS);
    retrieval = await ask<Retrieval>(`v1/retrievals/${retrieval.id}`);
  }
  if (retrieval.state === "failed") return say("launch.not-fetched", retrieval.reason?.detail);
  await follow();
}

function Launch() {
  const { choices, of } = offered.value;
  useLayoutEffect(() => document.querySelector<HTMLElement>("#actions button")?.focus(), [choices]);
  return (
    <main class="launch">
      <h1>Isocortex</h1>
      <p id="message" role="status">
        {message}
      </p>
      <div id="actions">
        {choices.map((one) => {
          const { case: id } = one;
          // What makes no case cannot be opened, but says that another patient is meant, perhaps.
          if (!id) return <p class="other">{wordsOf(one)}</p>;
          return (
            <Button key={id} onClick={() => attempt(open(id))}>
              {wordsOf(one)}
            </Button>
          );
        })}
        {of?.nodes.map((node) => (
          <Button onClick={() => attempt(fetchFrom(node, of))}>{t("launch.fetch", { node })}</Button>
        ))}
      </div>
      <p>
        <a href="./">{t("launch.all")}</a>
      </p>
      <p class="research" role="note">
        {t("notice.long")}
      </p>
    </main>
  );
}

/** Runs the document. Its query names a patient's study: before all else, it leaves the address and the history of the browser. */
export async function launching(): Promise<void> {
  isChoice = location.search === "?choose";
  launchQuery = isChoice ? takeChoice() : location.search;
  history.replaceState(null, "", location.pathname);
  const place = await begin("mounted");
  say("launch.looking");
  render(<Launch />, place);
  attempt(follow());
}
