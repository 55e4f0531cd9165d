// One of the two cases that are compared: a frame with the page, which shows it.

import { signal } from "@preact/signals";

import { getCase } from "../base/api.ts";
import { h } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { wait } from "../base/patience.ts";
import type { ReadyCase } from "../model/case.ts";
import { readAddress } from "../model/fragment.ts";
import type { Linked, Shown } from "../model/linked.ts";
import type { ViewState } from "../model/state.ts";

const LOOK_AGAIN_MS = 50;

export class Side {
  readonly element = h("div", { class: "side" });
  readonly name: "left" | "right";
  readonly title: string;
  /** The id of the case that was chosen; empty: none. */
  readonly chosen = signal("");
  /** Hears that the reader has changed how the case is shown. */
  readonly #changed: (side: Side) => void;
  #frame: HTMLIFrameElement | null = null;
  #shown: ReadyCase | null = null;
  #state: ViewState | null = null;
  #panes: Element | null = null;
  #isFollowing = false;
  /** What was opened before is given up. */
  #turn = 0;

  constructor(name: "left" | "right", changed: (side: Side) => void) {
    this.name = name;
    this.title = t(`compare.${name}`);
    this.#changed = changed;
  }

  /** The case and its state, once the frame shows it. */
  get now(): Shown | null {
    return this.#shown && this.#state && { shown: this.#shown, state: this.#state };
  }

  /** What the frame shows, as an address of the page. */
  get address(): string {
    return this.#frame?.contentWindow?.location.hash.replace(/^#/, "") ?? "";
  }

  /** Whether a warning stands above the picture. */
  get isWarned(): boolean {
    return (this.#frame?.contentDocument?.querySelector(".quality:not([hidden])") ?? null) !== null;
  }

  /** Keeps room for a warning above the picture, or not. */
  makeRoom(isWarned: boolean): void {
    this.#frame?.contentDocument?.documentElement.classList.toggle("warned", isWarned);
  }

  /** Shows what an address of the page says, in a frame of its own; an empty one: nothing. */
  async open(address: string): Promise<void> {
    this.close();
    const asked = readAddress(address);
    const id = asked.kind === "case" ? asked.id : "";
    this.chosen.value = id;
    if (id === "") return;
    const turn = this.#turn;
    this.expect();
    const shown = await getCase(id).catch((problem: unknown) => {
      if (turn === this.#turn) this.element.replaceChildren();
      throw problem;
    });
    if (turn !== this.#turn) return;
    const frame = h("iframe", { title: this.title, src: `./#${address}` });
    this.element.append(frame);
    this.#frame = frame;
    while (turn === this.#turn) {
      const inside = frame.contentDocument;
      const isLoaded = inside?.body?.dataset.loaded === "true";
      // A case that is not ready says so in its frame.
      if (isLoaded && shown.state !== "ready") return this.#frameIn(inside);
      const panes = isLoaded ? inside.querySelector(".panes") : null;
      if (panes && shown.state === "ready") return this.#meet(shown, panes);
      await wait(LOOK_AGAIN_MS);
    }
  }

  /** Says that a case is being opened. */
  expect(): void {
    this.element.replaceChildren(h("p", { class: "side-note", role: "status" }, t("compare.opening")));
  }

  close(): void {
    [this.#frame, this.#shown, this.#state, this.#panes] = [null, null, null, null];
    this.#turn += 1;
    this.element.replaceChildren();
  }

  /** Takes over what the other side shows. */
  follow(change: Linked | Record<string, never>): void {
    this.#isFollowing = true;
    this.#panes?.dispatchEvent(new CustomEvent("follow", { detail: change }));
    this.#isFollowing = false;
  }

  #meet(shown: ReadyCase, panes: Element): void {
    this.#shown = shown;
    this.#panes = panes;
    panes.addEventListener("view", (event) => {
      this.#state = (event as CustomEvent<ViewState>).detail;
      if (!this.#isFollowing) this.#changed(this);
    });
    this.#frameIn(panes.ownerDocument);
    // Changing nothing tells the state.
    this.follow({});
  }

  /** Leaves out of the page what stands around both frames. */
  #frameIn(inside: Document): void {
    this.element.querySelector(".side-note")?.remove();
    inside.documentElement.classList.add("framed");
    this.#frame?.classList.add("met");
    // The controls have too little room beside half a picture: they are one click away.
    const fold = inside.querySelector('use[href="#icon-panel"]')?.closest("button");
    if (fold?.getAttribute("aria-expanded") === "true") fold.click();
  }
}
