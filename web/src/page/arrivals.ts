// The series that came from a PACS: listed, filtered, and one that was refused taken as a case or as a layer.

import { createElement, render } from "preact";

import { send } from "../base/api.ts";
import { h, status, tell } from "../base/dom.ts";
import { type Key, known, moment, t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import { closing, open } from "./dialogs.ts";
import { button, choice, row } from "./elements.ts";
import { Rejections } from "./rejections.tsx";

const STATES = ["receiving", "case", "layer", "nothing"] as const;
type State = (typeof STATES)[number];

/** Why a series became nothing. */
interface Reason {
  readonly name: string;
  readonly detail: string;
}

/** A series that came, as the server lists it. */
export interface Arrival {
  readonly id: string;
  readonly state: State;
  readonly first_at: string;
  readonly instances: number;
  /** Images that took the place of others. */
  readonly corrected: number;
  /** Objects that were not kept. */
  readonly ignored: number;
  readonly expected?: number;
  readonly label?: string;
  readonly case?: string;
  readonly reason?: Reason;
  /** Why it was refused before somebody took it. */
  readonly refused?: Reason;
}

interface Page {
  readonly arrivals: readonly Arrival[];
  readonly next?: string;
}

/** What a series can be taken as. */
type Taken = "case" | "layer";

const LOOK_AGAIN_MS = 1000;
/** So long after the last letter the list is asked for. */
const TYPED_MS = 300;
/** The reason that somebody may overlook: the slices are interpolated. */
const GAPS = "dicom-slices-missing";

/** What a series can be taken as: what was refused as either, a layer as a case. */
export function takeable({ state, instances }: Pick<Arrival, "state" | "instances">): readonly Taken[] {
  if (state === "layer") return ["case"];
  return state === "nothing" && instances > 0 ? ["case", "layer"] : [];
}

const reasonWords = ({ name, detail }: Reason): string => {
  const key = known(`problem.${name}`);
  return key ? t(key) : t("problem.english", { detail: sentence(detail) });
};

/** What came, and what of it is not kept. */
export function arrivalFacts({ first_at, instances, expected, corrected, ignored }: Arrival): readonly string[] {
  const images = expected && expected !== instances ? "arrival.images-of" : "arrival.images";
  return [
    moment(first_at),
    t(images, { count: instances, expected }),
    ...(corrected > 0 ? [t("arrival.corrected", { count: corrected })] : []),
    ...(ignored > 0 ? [t("arrival.ignored", { count: ignored })] : []),
  ];
}

/** Shows what came; a link to a case closes the list, and `chosen` hears which. */
export function arrivalsDialog(chosen: (id: string) => void): void {
  new Arrivals(chosen).show();
}

class Arrivals {
  readonly #list = h("ul", { class: "arrivals" });
  readonly #note = status();
  readonly #text = h("input", {
    type: "search",
    id: "arrival-text",
    maxlength: 100,
    placeholder: t("arrivals.search"),
    "aria-label": t("arrivals.search"),
    input: () => this.#soon(),
    // Else it would close the list.
    keydown: (event: KeyboardEvent) => event.key === "Enter" && event.preventDefault(),
  });
  readonly #state: HTMLSelectElement;
  readonly #more = button(t("arrivals.more"), () => void this.#ask(this.#next));
  #next: string | null = null;
  #dialog: HTMLDialogElement | null = null;
  /** Of several answers the one to the latest question counts. */
  #turn = 0;
  #timer = 0;

  readonly #chosen: (id: string) => void;

  constructor(chosen: (id: string) => void) {
    this.#chosen = chosen;
    this.#more.hidden = true;
    const words = (state: State | ""): string => t(state ? `arrival.${state}` : "arrivals.all");
    this.#state = choice("arrival-state", t("arrivals.state"), ["", ...STATES], words, () => void this.#ask(null));
  }

  show(): void {
    const rejections = h("div", {});
    render(createElement(Rejections, { lifted: () => void this.#ask(null) }), rejections);
    const { dialog, closed } = open(
      t("arrivals.title"),
      "of-pacs",
      h("div", { class: "line" }, this.#text, this.#state),
      this.#note,
      this.#list,
      rejections,
      h("div", { class: "row end" }, this.#more, closing("close", t("close"), { class: "primary" })),
    );
    this.#dialog = dialog;
    void closed.then(() => {
      this.#turn += 1;
      render(null, rejections);
    });
    void this.#ask(null);
  }

  #soon(): void {
    clearTimeout(this.#timer);
    this.#timer = window.setTimeout(() => void this.#ask(null), TYPED_MS);
  }

  /** Lists those that the filter fits, from the newest or behind those that are listed. */
  async #ask(after: string | null): Promise<void> {
    const turn = (this.#turn += 1);
    const text = this.#text.value.trim();
    const query = new URLSearchParams({
      ...(this.#state.value && { state: this.#state.value }),
      ...(text && { text }),
      ...(after && { after }),
    });
    try {
      const page = (await (await send(`v1/arrivals?${query}`, { cache: "no-store" })).json()) as Page;
      if (turn !== this.#turn) return;
      const items = page.arrivals.map((one) => this.#item(one));
      if (after) this.#list.append(...items);
      else this.#list.replaceChildren(...items);
      this.#next = page.next ?? null;
      tell(this.#note, this.#list.childElementCount === 0 ? t("arrivals.none") : "");
    } catch (problem) {
      if (turn === this.#turn) tell(this.#note, problemWords(problem));
    }
    this.#more.hidden = this.#next === null;
  }

  #item(one: Arrival): HTMLElement {
    const { state, reason, refused, label } = one;
    const said = h("p", { class: "quiet", role: "status", hidden: true });
    const why = state === "nothing" && reason ? reasonWords(reason) : "";
    const before = state !== "nothing" && refused ? t("arrival.refused", { reason: reasonWords(refused) }) : "";
    const actions = takeable(one).map((as) => {
      const allow_gaps = as === "case" && reason?.name === GAPS;
      const words: Key = allow_gaps ? "arrival.take-gaps" : `arrival.take-${as}`;
      return button(t(words), () => void this.#take(one, { as, allow_gaps }, item, said));
    });
    const item = h(
      "li",
      { "data-id": one.id, "data-state": state },
      h(
        "p",
        { class: "layer-name" },
        h("strong", {}, label ?? t("arrival.unlabelled")),
        h("span", { class: "state" }, t(`arrival.${state}`)),
      ),
      h("p", { class: "quiet" }, arrivalFacts(one).join(" · ")),
      why ? h("p", { class: "why" }, why) : null,
      before ? h("p", { class: "quiet" }, before) : null,
      row(one.case ? this.#link(one.case) : null, ...actions),
      said,
    );
    return item;
  }

  #link(id: string): HTMLElement {
    const click = (): void => {
      this.#chosen(id);
      this.#dialog?.close();
    };
    return h("a", { href: `#${id}`, click }, t("arrival.open"));
  }

  /** Takes a series, and says what becomes of it. */
  async #take(one: Arrival, body: { as: Taken; allow_gaps: boolean }, item: Element, said: HTMLElement): Promise<void> {
    for (const each of item.querySelectorAll("button")) each.disabled = true;
    tell(said, t("arrival.taking"));
    const path = `v1/arrivals/${one.id}`;
    try {
      let now = (await (await send(path, { method: "POST", body: JSON.stringify(body) })).json()) as Arrival;
      while (now.state === "receiving" && item.isConnected) {
        await wait(LOOK_AGAIN_MS);
        now = (await (await send(path, { cache: "no-store" })).json()) as Arrival;
      }
      const fresh = this.#item(now);
      const hadFocus = item.contains(document.activeElement) || document.activeElement === document.body;
      item.replaceWith(fresh);
      tell(this.#note, `${now.label ?? t("arrival.unlabelled")}: ${t(`arrival.${now.state}`)}`);
      if (hadFocus) fresh.querySelector<HTMLElement>("a, button")?.focus();
    } catch (problem) {
      for (const each of item.querySelectorAll("button")) each.disabled = false;
      tell(said, problemWords(problem));
    }
  }
}
