// Opens the case of the study that the address names, says how far it is, or asks which of several is meant.

import { isChoice, launchQuery } from "./query.ts";
import { handOver, onTokenWanted, send } from "../base/api.ts";
import { leaveLaunch } from "../base/launched.ts";
import { h, setText } from "../base/dom.ts";
import { type Key, known, learn, numberUpTo, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import { dateWords } from "../pacs/neighbour.ts";
import { askToken } from "../page/dialogs.ts";
import { preferences } from "../store/preferences.ts";

const LOOK_AGAIN_MS = 2000;

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

const ask = async <Answer>(path: string, body?: unknown): Promise<Answer> => {
  const options = body ? { method: "POST", body: JSON.stringify(body) } : { cache: "no-store" as const };
  return (await send(path, options)).json() as Promise<Answer>;
};

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

class Launch {
  readonly #message = h("p", { id: "message", role: "status" }, t("launch.looking"));
  readonly #actions = h("div", { id: "actions" });

  constructor() {
    document.body.append(
      h(
        "main",
        { class: "launch" },
        h("h1", {}, "Isocortex"),
        this.#message,
        this.#actions,
        h("p", {}, h("a", { href: "./" }, t("launch.all"))),
        h("p", { class: "research", role: "note" }, t("notice.long")),
      ),
    );
  }

  async start(): Promise<void> {
    try {
      await this.#follow();
    } catch (problem) {
      setText(this.#message, problemWords(problem));
    }
  }

  #say(key: Key, reason = "", values: Readonly<Record<string, unknown>> = {}): void {
    setText(this.#message, `${t(key, values)} ${reason && sentence(reason)}`.trim());
  }

  /** Looks again and again until there is something to open, or nothing will come. */
  async #follow(): Promise<void> {
    for (;;) {
      const found = await ask<Found>("v1/launch", { query: launchQuery });
      const reason = found.reason?.detail ?? "";
      if (isChoice && found.candidates.length > 1) {
        this.#say("launch.several");
        return this.#choose(found.candidates);
      }
      switch (found.state) {
        case "ready":
          if (found.ignored.length === 0 && found.case) return this.#open(found.case, found.candidates.length - 1);
          // Perhaps they should have narrowed the search.
          this.#say("launch.ignored", "", { keys: found.ignored.join(", ") });
          return this.#choose(found.candidates);
        case "choice":
          this.#say("launch.choice");
          return this.#choose(found.candidates);
        case "mismatch":
          return this.#say("launch.mismatch");
        case "failed":
          return this.#say("launch.failed", reason);
        case "nothing":
          return this.#say("launch.nothing", reason);
        case "preparing":
        case "receiving":
          this.#say(`launch.${found.state}`);
          break;
        default:
          this.#say("launch.absent");
          return this.#offer(found);
      }
      await wait(LOOK_AGAIN_MS);
    }
  }

  /**
   * Opens a case; the page takes the token from here, and asks nobody a second time. A page that does not load would
   * leave it there until the tab is closed, so look first.
   */
  async #open(id: string, others = 0): Promise<void> {
    try {
      await send("./", { cache: "no-cache" });
    } catch (problem) {
      return setText(this.#message, problemWords(problem));
    }
    handOver();
    if (others > 0) leaveLaunch({ id, others, query: launchQuery });
    location.replace(`./#${id}`);
  }

  #choose(candidates: readonly Candidate[]): void {
    const choices = candidates.map((one) => {
      const { case: id } = one;
      // What makes no case cannot be opened, but says that another patient is meant, perhaps.
      return id
        ? h("button", { click: () => void this.#open(id) }, wordsOf(one))
        : h("p", { class: "other" }, wordsOf(one));
    });
    this.#actions.replaceChildren(...choices);
    this.#actions.querySelector("button")?.focus();
  }

  /** Buttons that fetch the series from one of the nodes. */
  #offer(found: Found): void {
    const buttons = found.nodes.map((node) =>
      h("button", { click: () => void this.#fetch(node, found) }, t("launch.fetch", { node })),
    );
    this.#actions.replaceChildren(...buttons);
  }

  async #fetch(node: string, { study, series }: Found): Promise<void> {
    this.#actions.replaceChildren();
    this.#say("launch.fetching");
    try {
      let retrieval = await ask<Retrieval>("v1/retrievals", { node, study, series });
      while (retrieval.state === "queued" || retrieval.state === "running") {
        await wait(LOOK_AGAIN_MS);
        retrieval = await ask<Retrieval>(`v1/retrievals/${retrieval.id}`);
      }
      if (retrieval.state === "failed") return this.#say("launch.not-fetched", retrieval.reason?.detail);
    } catch (problem) {
      return setText(this.#message, problemWords(problem));
    }
    await this.start();
  }
}

async function build(): Promise<void> {
  const { language, theme } = preferences.peek();
  document.documentElement.dataset.theme = theme;
  await learn(language);
  document.documentElement.lang = language;
  onTokenWanted(askToken);
  await new Launch().start();
}

void build();
