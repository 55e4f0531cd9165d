// What the page does around the chosen case: which one is shown, how another one is, and who looks.

import { computed, effect, signal, untracked } from "@preact/signals";

import { anyArrivals, changeCase, deleteCase, getCase, getHolder, handOver } from "../base/api.ts";
import { caseIdentity, caseTitle } from "../base/case-words.ts";
import { spoken, t } from "../base/i18n.ts";
import { leaveChoice, takeLaunch } from "../base/launched.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case } from "../model/case.ts";
import { type Address, type OfCase, readAddress } from "../model/fragment.ts";
import { commandOf, recallOf } from "../model/keys.ts";
import { ViewMemory } from "../model/memory.ts";
import { hasSlices } from "../model/state.ts";
import { ALL, listAddress } from "../model/worklist.ts";
import { announce, announced, noted } from "../store/announce.ts";
import { Cases } from "../store/cases.ts";
import { perform } from "../store/commands.ts";
import { holder, mayWrite } from "../store/holder.ts";
import { followPerson, isKept } from "../store/person.ts";
import { choose, preferences, unfold } from "../store/preferences.ts";
import { AGAIN_MS, isFinal } from "../store/sync.ts";
import { askDropped, confirmDelete, helpDialog } from "./dialogs.tsx";
import { Upload } from "./upload.tsx";
import { Viewer } from "./viewer.tsx";

/** Below this width the list lies over the picture, as in the style sheet. */
const BESIDE_PIXELS = 700;
const serverOnly = new URLSearchParams(location.search).get("renderer") === "server";

export class App {
  readonly cases = new Cases();
  readonly upload = new Upload((one, wasThere) => this.made(one, wasThere));
  /** The case of the address. */
  readonly chosen = signal<Case | null>(null);
  /** What shows it, if it is ready. */
  readonly viewer = signal<Viewer | null>(null);
  /** Why the case of the address cannot be shown; empty where it can. */
  readonly absence = signal("");
  /** Whether no case is shown, and the list has all the room. */
  readonly isStart = signal(false);
  /** The list is beside a picture where it is wanted, and as long as there is none where there is room. */
  readonly hasList = computed(() => {
    const isWide = window.innerWidth >= BESIDE_PIXELS;
    if (this.isStart.value && !this.cases.isEmpty.value) return true;
    return preferences.value.list || (isWide && !this.viewer.value);
  });
  /** The case that was put into the trash last, until something else becomes of it. */
  readonly trashed = signal<Case | null>(null);
  readonly isSilent = signal(false);
  readonly hasArrivals = signal(false);
  /** What a study was opened by, if other heads of it are here too; null once that was read and dismissed. */
  readonly launched = signal(takeLaunch());
  readonly #memory = new ViewMemory();
  #routed = 0;
  /** Whether the next key may be the number of a saved layout. */
  #awaitsNumber = false;
  /** Whether a key is held that hides what lies over the head. */
  #isHeld = false;

  async start(): Promise<void> {
    const before = preferences.peek();
    effect(() => {
      // Whatever becomes of the cases, the one of the address may be there now, or another one.
      void this.cases.here.value;
      if (this.cases.isListed.value) untracked(() => void this.route());
    });
    effect(() => {
      const { layout } = this.viewer.value?.store.view.state.value ?? {};
      document.body.classList.toggle("viewing", layout !== undefined);
      if (layout) Object.assign(document.body.dataset, { layout, slices: hasSlices({ layout }) });
    });
    effect(() => {
      // The label that a user gave, never an identity out of DICOM: the browser's history keeps titles.
      document.title = this.chosen.value ? `${caseIdentity(this.chosen.value)} · Isocortex` : "Isocortex";
    });
    effect(() => {
      if (preferences.value.language !== spoken()) untracked(() => void this.#beginAgain());
    });
    effect(() => {
      const address = listAddress(this.cases.filter.value);
      if (this.isStart.value && this.cases.filter.value !== ALL) history.replaceState(null, "", address);
    });
    await this.cases.refresh();
    document.body.dataset.loaded = "true";
    // Where there is no room beside it, the area for files is in sight alone.
    if (this.cases.isEmpty.peek() && window.innerWidth >= BESIDE_PIXELS) this.upload.isOpen.value = true;
    // Of what was refused there is no case: its list is offered once anything has come.
    effect(() => {
      if (this.cases.total.value >= 0 && !this.hasArrivals.peek()) void this.#lookForArrivals();
    });
    // Whoever may not look at anything may not ask either.
    if (parent !== window) return;
    await this.#meet(before);
  }

  /** Learns who looks, also if the server does not answer at first. */
  async #meet(before: object): Promise<void> {
    try {
      holder.value = await getHolder();
      await followPerson({ ...before });
    } catch (problem) {
      if (!isFinal(problem)) setTimeout(() => void this.#meet(before), AGAIN_MS);
    }
  }

  async #lookForArrivals(): Promise<void> {
    this.hasArrivals.value = await anyArrivals().catch(() => false);
  }

  /** Loads the page in another language; all that is shown is in the address. */
  async #beginAgain(): Promise<void> {
    const store = this.viewer.peek()?.store;
    store?.sweep.stop();
    store?.view.rest();
    handOver();
    await isKept();
    location.reload();
  }

  chooseFiles(): void {
    choose({ list: true });
    this.upload.choose();
  }

  /** On an open case, files may be its layers or another case: the reader says which, unless they were dropped on a form. */
  async drop(files: readonly File[], onto: Element | null): Promise<void> {
    if (!mayWrite.peek() || files.length === 0) return;
    const viewer = this.viewer.peek();
    const form = onto?.closest("#add, .add-layer");
    const answer =
      !viewer || form?.id === "add" ? "case" : form ? "layer" : await askDropped(viewer.store.shown, files);
    if (answer === "case") {
      choose({ list: true });
      this.upload.drop(files);
    } else if (answer === "layer" && viewer && !viewer.store.isOver) {
      const { store } = viewer;
      choose({ panel: true });
      unfold("panel.layers", true);
      store.isAlone.value = false;
      store.task.value = "images";
      store.layers.dropped.value = { files, isOnForm: Boolean(form) };
    }
  }

  async made({ id }: Case, wasThere: boolean): Promise<void> {
    this.cases.flag(id, t(wasThere ? "case.was-there" : "case.fresh"));
    await this.cases.refresh();
  }

  /** The server has stopped answering, or answers again. */
  reach(isReachable: boolean): void {
    this.isSilent.value = !isReachable;
    if (!isReachable) return;
    void this.cases.refresh();
    this.viewer.peek()?.again();
  }

  /** Leads back to the choice among the heads of a study. */
  chooseHead(): void {
    const from = this.launched.peek();
    handOver();
    if (from) leaveChoice(from);
  }

  /** Shows the case that the address names; without an address the only case there is. */
  async route(): Promise<void> {
    const turn = (this.#routed += 1);
    const address = readAddress(location.hash);
    const id = address.kind === "case" ? address.id : address.kind === "none" ? this.cases.only : null;
    if (address.kind === "list") this.cases.choose({ ...address.filter, text: this.cases.filter.peek().text });
    let absence = address.kind === "unknown" ? t("address.unknown") : "";
    let chosen: Case | null = this.cases.here.peek().find((one) => one.id === id) ?? null;
    if (id && !chosen)
      chosen = await getCase(id).catch((problem: unknown) => {
        const before = this.chosen.peek();
        // A server that does not answer closes no case.
        if (before?.id === id && !isFinal(problem)) return before;
        absence = problemWords(problem);
        return null;
      });
    // Another address may have come in the meantime.
    if (turn !== this.#routed) return;
    this.absence.value = absence;
    this.cases.show(id);
    // What was shown without being named keeps its place, whatever else is added.
    if (chosen && address.kind === "none") history.replaceState(null, "", `#${chosen.id}`);
    this.#show(chosen, address);
  }

  /** The address was changed by Back, or by hand. */
  async addressChanged(): Promise<void> {
    const before = this.viewer.peek();
    await this.route();
    const viewer = this.viewer.peek();
    if (!before || !viewer) return;
    const address = readAddress(location.hash);
    const { shown, remark } = viewer.store;
    if (viewer === before) {
      if (address.kind === "case" && address.id === shown.id) viewer.restore(address);
      return;
    }
    // Back and Forward also lead to other patients.
    if (shown.id === before.store.shown.id || shown.id === this.cases.chosen) return;
    remark.value = t("address.other", { title: caseIdentity(shown) });
    announce(remark.peek());
  }

  #show(chosen: Case | null, address: Address): void {
    this.chosen.value = chosen;
    this.isStart.value = chosen === null;
    const ready = chosen?.state === "ready" ? chosen : null;
    const before = this.viewer.peek();
    if (ready?.id === before?.store.shown.id) return;
    if (before) this.#memory.keep(before.store.shown, before.store.view.left);
    before?.dispose();
    // What was said of the case before is not of this one.
    announced.value = "";
    noted.value = { ...noted.peek(), words: "" };
    const { rest = "", finding = "" }: Partial<OfCase> = address.kind === "case" ? address : {};
    this.viewer.value =
      ready && new Viewer(ready, { rest, finding, left: this.#memory.of(ready), serverOnly, shared: null });
    // Where the list lies over the picture, it has been chosen from.
    if (ready && window.innerWidth < BESIDE_PIXELS) choose({ list: false });
  }

  /** Puts a case into the trash, or takes it out. */
  async trash(one: Case, trashed: boolean): Promise<void> {
    this.trashed.value = null;
    try {
      await changeCase(one.id, { trashed });
      this.trashed.value = trashed ? one : null;
      await this.#changed(t(trashed ? "trash.done" : "trash.undone", { title: caseTitle(one) }));
    } catch (problem) {
      this.absence.value = problemWords(problem);
    }
  }

  /** Deletes a case for good. */
  async remove(one: Case): Promise<void> {
    if (!(await confirmDelete(t("delete.title"), t("delete.text", { title: caseIdentity(one) })))) return;
    try {
      await deleteCase(one.id);
      this.#memory.forget(one.id);
      if (this.chosen.peek()?.id === one.id) history.replaceState(null, "", location.pathname + location.search);
      await this.#changed(t("delete.done"));
    } catch (problem) {
      this.absence.value = problemWords(problem);
    }
  }

  async #changed(words: string): Promise<void> {
    await this.cases.refresh();
    announce(words);
    // The button that had the focus is gone.
    if (document.activeElement === document.body) document.getElementById("case-search")?.focus();
  }

  /** What a key did while it was held is over. */
  release(): void {
    const viewer = this.viewer.peek();
    if (viewer && this.#isHeld) perform(viewer.store, { kind: "release" });
    this.#isHeld = false;
  }

  /** A key that is no one else's. */
  key(event: KeyboardEvent): void {
    // Dialogs are children of the body: looking through a thousand findings for one would take longer than a frame has.
    const isCovered = [...document.body.children].some((one) => one.matches("dialog[open]"));
    // Escape closes the box of a tool, and that alone.
    const isOfBox = event.key === "Escape" && document.querySelector(".menu:popover-open") !== null;
    if (event.defaultPrevented || !(event.target instanceof HTMLElement) || isCovered || isOfBox) return;
    const onPicture = event.target.closest(".pane.surface") !== null;
    const hasModifier = event.ctrlKey || event.metaKey;
    // Where text is typed, undoing is the text's.
    const typed = "input:not([type=range], [type=checkbox]), textarea";
    const ofField = event.target.closest(hasModifier ? typed : `${typed}, select`);
    // From what is written in the panel, back to the picture.
    if (ofField?.closest(".panel") && event.key === "Escape") document.getElementById("stage")?.focus();
    const isLetter = !hasModifier && event.key !== "Escape";
    if (!onPicture && (ofField || (isLetter && !preferences.peek().shortcuts))) return;
    const command = (this.#awaitsNumber && recallOf(event)) || commandOf(event);
    // A key that is held with another one is not the one that was awaited.
    if (event.key !== "Shift") this.#awaitsNumber = command?.kind === "layouts";
    if (!command) return;
    // A button or a link is worked by these; a page is scrolled.
    const ofControl =
      event.target.closest("button, a, summary, input") !== null && (event.key === " " || event.key === "Enter");
    const scrolls = event.target.closest("#sidebar, .rows, .menu") ? /^(Arrow|Page)/ : /^Arrow/;
    const ofPage = !onPicture && (scrolls.test(event.key) || event.key === "Enter");
    if (ofControl || ofPage) return;
    const viewer = this.viewer.peek();
    if (command.kind !== "help" && !viewer) return;
    event.preventDefault();
    if (command.kind === "help") helpDialog();
    else if (viewer) perform(viewer.store, command);
    this.#isHeld ||= command.kind === "hold";
  }
}
