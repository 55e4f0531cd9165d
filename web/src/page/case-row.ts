// A row of the list: one case.

import {
  caseFacts,
  caseIdentity,
  caseStatus,
  caseTitle,
  titleParts,
  toldApart,
  versionOf,
} from "../base/case-words.ts";
import { h, iconButton, setText, tell } from "../base/dom.ts";
import { t } from "../base/i18n.ts";
import { served } from "../base/picture.ts";
import { NAMED_VIEWS } from "../model/camera.ts";
import type { Case } from "../model/case.ts";
import { doubtsOf, qualityOf } from "../model/quality.ts";
import { renderQuery } from "../model/query.ts";
import { firstState } from "../model/state.ts";

const THUMB_PIXELS = 96;

/** One case of the list. */
export class Row {
  readonly element: HTMLElement;
  readonly #link: HTMLAnchorElement;
  readonly #id = h("span", { class: "id" });
  readonly #thumb = h("span", { class: "thumb", "aria-hidden": "true" });
  readonly #title = h("span", { class: "title" });
  readonly #status = h("span", { class: "status" });
  readonly #version = h("span", { class: "status", hidden: true });
  readonly #badgeText = h("span", { class: "visually-hidden" });
  readonly #badge = h("span", { class: "quality-badge", hidden: true }, this.#badgeText);
  readonly #closed = h("span", { class: "closed-badge", hidden: true });
  readonly #fresh = h("span", { class: "fresh-badge", hidden: true });
  readonly #bar = h("progress", { max: 1, "aria-label": t("case.progress"), hidden: true });
  readonly #delete: HTMLButtonElement;
  #case: Case;
  #thumbAsked = false;

  constructor(one: Case, remove: (one: Case) => void) {
    this.#case = one;
    setText(this.#id, one.id.slice(0, 8));
    this.#link = h(
      "a",
      {
        href: `#${one.id}`,
        "aria-keyshortcuts": "Delete",
        click: (event: MouseEvent) => this.#stay(event),
        keydown: ({ key }: KeyboardEvent) => key === "Delete" && remove(this.#case),
      },
      this.#thumb,
      h(
        "span",
        { class: "words" },
        h("span", { class: "head" }, this.#title, this.#badge),
        h("span", { class: "facts" }, this.#fresh, this.#closed, this.#id, this.#status, this.#version),
        this.#bar,
      ),
    );
    this.#delete = iconButton("trash", t("delete.button", { title: caseIdentity(one) }), () => remove(this.#case));
    // A row is one stop of the tabulator: its key is Delete.
    this.#delete.tabIndex = -1;
    this.element = h("li", { "data-id": one.id }, this.#link, this.#delete);
  }

  /** Shows a case among those that have its title. */
  show(one: Case, alike: readonly Case[]): void {
    this.#case = one;
    this.element.dataset.state = one.state;
    this.#tellTitle(caseTitle(one));
    this.element.title = caseFacts(one);
    const apart = toldApart(one, alike);
    setText(this.#status, apart || caseStatus(one));
    const version = versionOf(one);
    tell(this.#version, version);
    // There is room for one of them.
    this.#status.hidden = version !== "" && one.state === "ready";
    // What tells it apart from others with its title has the room of its id, which names a case without a label above.
    this.#id.hidden = !one.name || (apart !== "" && version === "");
    const quality = one.state === "ready" ? qualityOf(one) : null;
    const doubts = quality ? doubtsOf(quality) : [];
    const [doubt] = doubts;
    this.#badge.hidden = !doubt;
    if (quality && doubt) {
      setText(this.#badgeText, t(`quality.${doubt}`));
      this.#badge.title = doubts.map((one) => t(`quality.${one}`)).join("\n");
      this.#badge.dataset.verdict = quality.state;
    }
    tell(this.#closed, one.closed ? t(`closed.${one.closed}`) : "");
    this.#bar.hidden = one.state !== "preparing";
    if (one.state === "preparing") this.#bar.value = one.progress?.fraction ?? 0;
  }

  /** A long title is cut in its middle. */
  #tellTitle(title: string): void {
    if (this.#title.textContent === title) return;
    const [begins, ends] = titleParts(title);
    if (ends === "") return setText(this.#title, title);
    this.#title.replaceChildren(h("span", { class: "begins" }, begins), h("span", { class: "ends" }, ends));
  }

  /** Whether the row is taken out of reach, because the open one covers it. */
  conceal(isConcealed: boolean): void {
    this.element.style.visibility = isConcealed ? "hidden" : "";
  }

  /** The row is in sight: its picture is asked for. */
  look(): void {
    if (this.#case.state === "ready") void this.#showThumb(this.#case);
  }

  /** Which row of how many it is, for those who do not see it. */
  place(at: number, count: number): void {
    this.element.setAttribute("aria-posinset", String(at + 1));
    this.element.setAttribute("aria-setsize", String(count));
  }

  focus(): void {
    this.#link.focus({ preventScroll: true });
  }

  /** The case that is open stays as it is. */
  #stay(event: MouseEvent): void {
    if (this.#link.hasAttribute("aria-current")) event.preventDefault();
  }

  /** Shows why the case is marked as new; empty: it is not. */
  flag(why: string): void {
    tell(this.#fresh, why);
  }

  mark(chosen: boolean): void {
    if (chosen) this.#link.setAttribute("aria-current", "true");
    else this.#link.removeAttribute("aria-current");
  }

  async #showThumb(one: Case & { state: "ready" }): Promise<void> {
    if (this.#thumbAsked) return;
    this.#thumbAsked = true;
    try {
      const state = { ...firstState(one), orientation: NAMED_VIEWS.left, way: "exact" } as const;
      const path = `${one.id}/render?${renderQuery(state, [THUMB_PIXELS, THUMB_PIXELS])}`;
      const image = await served({ path });
      this.#thumb.replaceChildren(image);
    } catch {
      // The list works without the picture. A row that is built again asks for it again.
    }
  }
}
