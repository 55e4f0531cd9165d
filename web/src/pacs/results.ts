// Results for the PACS: chosen, previewed, sent to a node or saved.

import { send } from "../base/api.ts";
import { h, quiet } from "../base/dom.ts";
import { known, moment, spoken, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { decoded } from "../base/picture.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import type { Finding } from "../model/findings.ts";

/** The picture on the screen in so many pixels, as a body of the server's interface. */
export type Render = (side: number) => Readonly<Record<string, unknown>>;

const KINDS = ["view", "sheet", "envelope", "mask", "findings", "finding-segments", "report"] as const;
type Kind = (typeof KINDS)[number];
const PICTURES: readonly Kind[] = ["view", "sheet"];

/** What a reader has marked. */
export interface Marks {
  readonly list: readonly Pick<Finding, "is_dismissed" | "is_unconfirmed">[];
  /** Resolves when the server has all of it; rejects if it cannot have it. */
  flush(): Promise<void>;
}

/** What there is to send: no findings if none is confirmed, and no segments of those that were dismissed. */
function kindsOf({ list }: Marks): readonly Kind[] {
  const confirmed = list.filter((one) => !one.is_unconfirmed);
  const lacks = (kind: Kind): boolean =>
    (kind === "findings" && confirmed.length === 0) ||
    (kind === "finding-segments" && confirmed.every((one) => one.is_dismissed));
  return KINDS.filter((kind) => !lacks(kind));
}
const LOOK_AGAIN_MS = 500;
const PIXELS = 512;
/** How long a browser may take to read what is saved. */
const SAVING_MS = 60_000;

/** A result that is being sent, or was. */
interface Sending {
  readonly id: string;
  readonly node: string;
  readonly state: "queued" | "running" | "done" | "failed";
  readonly attempts: number;
  readonly reason?: { readonly detail?: string };
  /** Why it does not count any more. */
  readonly not_valid?: string;
  readonly created_at: string;
}

/** How far the sending of a result is. */
function sendingWords({ node, state, attempts, reason, not_valid = "" }: Sending): string {
  const isTried = state === "queued" && attempts > 0;
  const words = t(isTried ? "sending.again" : `sending.${state}`, {
    node,
    count: attempts,
    reason: sentence(reason?.detail ?? ""),
  });
  const invalid = known(`sent.${not_valid}`);
  return invalid ? `${words} ${t(invalid)}` : words;
}

/** The body of a request for a result of a kind. */
function bodyOf(kind: Kind, render: Readonly<Record<string, unknown>>): Readonly<Record<string, unknown>> {
  switch (kind) {
    case "view":
      return { what: "view", render };
    case "sheet": {
      // Each cell has a depth and a direction of its own, and shows the whole head.
      const { depth_mm, slab_mm, orientation, view, zoom, pan, ...plain } = render;
      return { what: "sheet", render: { ...plain, width: PIXELS / 2, height: PIXELS / 2 }, sheet: {} };
    }
    case "report":
      return { what: "report", report: { language: spoken() } };
    default:
      return { what: kind };
  }
}

/** The section of the panel that opens the dialog. */
export function resultsSection(id: string, nodes: readonly string[], render: Render, marks: () => Marks): HTMLElement {
  const sent = h("ol", { class: "sent-results", "aria-label": t("pacs.sent") });
  const list = (): void => void listSent(id, sent);
  const open = h(
    "button",
    { click: () => new ResultDialog(id, nodes, render, marks()).show().addEventListener("close", list) },
    t("pacs.open"),
  );
  const body = h("div", { class: "group-body" }, quiet(t("pacs.text")), h("div", { class: "row" }, open), sent);
  return h("details", { class: "group pacs", toggle: list }, h("summary", {}, t("pacs.title")), body);
}

/** Lists the results of a case that are being sent or were, the newest first. */
async function listSent(id: string, list: HTMLElement): Promise<void> {
  try {
    const answer = await send(`v1/dicom-results?case=${id}`, { cache: "no-store" });
    const { results } = (await answer.json()) as { readonly results: readonly Sending[] };
    const items = results.map((one) =>
      h("li", { "data-state": one.state }, `${moment(one.created_at)}: ${sendingWords(one)}`),
    );
    list.replaceChildren(...items);
  } catch (problem) {
    list.replaceChildren(h("li", { class: "bad" }, problemWords(problem)));
  }
}

class ResultDialog {
  readonly #id: string;
  readonly #render: Render;
  readonly #marks: Marks;
  readonly #kind: HTMLSelectElement;
  readonly #node: HTMLSelectElement;
  readonly #place = h("div", { class: "server-shot" });
  readonly #said = h("p", { class: "quiet", role: "status", id: "result-said" });
  readonly #send = h("button", { class: "primary", click: () => void this.#work(() => this.#sent()) }, t("pacs.send"));
  readonly #save = h("button", { click: () => void this.#work(() => this.#saved()) }, t("pacs.save"));
  readonly #dialog: HTMLDialogElement;

  constructor(id: string, nodes: readonly string[], render: Render, marks: Marks) {
    this.#id = id;
    this.#render = render;
    this.#marks = marks;
    const option = (value: string, words: string): HTMLElement => h("option", { value }, words);
    this.#kind = h(
      "select",
      { id: "result-kind", change: () => void this.#preview() },
      ...kindsOf(marks).map((kind) => option(kind, t(`result.${kind}`))),
    );
    this.#node = h("select", { id: "result-node" }, ...nodes.map((node) => option(node, node)));
    this.#dialog = h(
      "dialog",
      { class: "dialog server-picture result", "aria-labelledby": "result-title", close: () => this.#dialog.remove() },
      h(
        "form",
        { method: "dialog" },
        h("h2", { id: "result-title" }, t("pacs.heading")),
        h("label", {}, t("pacs.what"), this.#kind),
        h("label", {}, t("pacs.node"), this.#node),
        this.#place,
        this.#said,
        h("div", { class: "row end" }, h("button", { type: "submit" }, t("pacs.close")), this.#save, this.#send),
      ),
    );
  }

  show(): HTMLElement {
    document.body.append(this.#dialog);
    this.#dialog.showModal();
    void this.#preview();
    return this.#dialog;
  }

  get #chosen(): Kind {
    return KINDS.find((kind) => kind === this.#kind.value) ?? "view";
  }

  #say(words: string): void {
    this.#said.textContent = words;
  }

  /** Asks for the result, or for a picture of it. */
  async #ask(
    more: Readonly<Record<string, unknown>>,
    headers: Readonly<Record<string, string>> = {},
  ): Promise<Response> {
    // The server makes them of what it has.
    if (this.#chosen === "findings" || this.#chosen === "finding-segments") await this.#marks.flush();
    const body = JSON.stringify({ ...bodyOf(this.#chosen, this.#render(PIXELS)), ...more });
    return send(`v1/cases/${this.#id}/dicom-results`, { method: "POST", body, headers });
  }

  /** Draws the first picture of what is chosen, unless something else has been chosen by then. */
  async #preview(): Promise<void> {
    const chosen = this.#chosen;
    this.#dialog.dataset.preview = "";
    this.#say("");
    const isPicture = PICTURES.includes(chosen);
    this.#place.replaceChildren(quiet(t(isPicture ? "pacs.drawing" : "pacs.no-picture")));
    if (!isPicture) return;
    try {
      const image = await decoded(await (await this.#ask({}, { accept: "image/png" })).blob());
      if (chosen !== this.#chosen) return;
      image.alt = t("pacs.preview");
      this.#place.replaceChildren(image);
      this.#dialog.dataset.preview = chosen;
    } catch (problem) {
      if (chosen === this.#chosen) this.#place.replaceChildren(h("p", { class: "bad" }, problemWords(problem)));
    }
  }

  /** Does something with the result; nothing else can be asked for meanwhile. */
  async #work(step: () => Promise<void>): Promise<void> {
    const controls = [this.#kind, this.#node, this.#send, this.#save];
    for (const one of controls) one.disabled = true;
    try {
      await step();
    } catch (problem) {
      this.#say(problemWords(problem));
    }
    for (const one of controls) one.disabled = false;
  }

  async #saved(): Promise<void> {
    this.#say(t("pacs.drawing"));
    const address = URL.createObjectURL(await (await this.#ask({})).blob());
    h("a", { href: address, download: `isocortex-${this.#id.slice(0, 8)}-${this.#chosen}.dcm` }).click();
    setTimeout(() => URL.revokeObjectURL(address), SAVING_MS);
    this.#say(t("pacs.saved"));
  }

  async #sent(): Promise<void> {
    const node = this.#node.value;
    this.#say(t("pacs.drawing"));
    let result = (await (await this.#ask({ node })).json()) as Sending;
    while (this.#dialog.isConnected && (result.state === "queued" || result.state === "running")) {
      this.#say(sendingWords(result));
      await wait(LOOK_AGAIN_MS);
      result = (await (await send(`v1/dicom-results/${result.id}`, { cache: "no-store" })).json()) as Sending;
    }
    this.#say(sendingWords(result));
  }
}
