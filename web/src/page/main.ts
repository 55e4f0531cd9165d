// The page: the list of cases at one side, the chosen case in the middle, its controls at the other side.

import {
  anyArrivals,
  deleteCase,
  getCase,
  getHolder,
  handOver,
  onReach,
  onTokenWanted,
  plainName,
} from "../base/api.ts";
import { computed, effect } from "@preact/signals";

import { AcquiredSlices } from "./acquired.ts";
import { arrivalsDialog } from "./arrivals.ts";
import type { Case } from "../model/case.ts";
import { caseIdentity, caseStatus, caseTitle, reasonWords } from "../base/case-words.ts";
import { CaseList } from "./cases.ts";
import { commandOf, keyOf, recallOf } from "../model/keys.ts";
import { h, iconButton, setText, tell } from "../base/dom.ts";
import { leaveChoice, takeLaunch } from "../base/launched.ts";
import { readAddress } from "../model/fragment.ts";
import { LANGUAGES, type Language, isLanguage, learn, number, t } from "../base/i18n.ts";
import { choice, choiceOfButtons, press } from "./elements.ts";
import type { Surface } from "../store/surface.ts";
import { announce, announced } from "../store/announce.ts";
import { perform, setLayout } from "../store/commands.ts";
import { choose, preferences } from "../store/preferences.ts";
import { askToken, confirmDelete, helpDialog, holderDialog, maskDialog } from "./dialogs.ts";
import { resizer } from "./resizer.ts";
import { problemWords } from "../base/problem-words.ts";
import { doubtsOf, qualityOf } from "../model/quality.ts";
import { ViewMemory } from "../model/memory.ts";
import { LAYOUTS, hasSlices } from "../model/state.ts";
import { hearDrops } from "./drops.ts";
import { Upload } from "./upload.tsx";
import { Viewer } from "./viewer.tsx";

const serverOnly = new URLSearchParams(location.search).get("renderer") === "server";
/** What a study was opened by, if other heads of it are here too; null once that was read and dismissed. */
let launched = takeLaunch();
/** How each case was left; kept while the page is open. */
const memory = new ViewMemory();

/** Below this width the list lies over the picture, as in the style sheet. */
const BESIDE_PIXELS = 700;

/** What draws a case, between two languages. */
interface Kept {
  readonly id: string;
  readonly surface: Surface;
}

/** Everything on the page, in one language. */
class App {
  readonly #live = h("div", { class: "visually-hidden", id: "live", role: "status", "aria-live": "polite" });
  readonly #title = h("h2", { id: "case-title" });
  readonly #note = h("p", { id: "case-note", class: "stage-note", role: "status" });
  readonly #acquired = new AcquiredSlices();
  /** What a server without a case shows. */
  readonly #start = h(
    "div",
    { class: "start", hidden: true },
    h("p", {}, t("start.drop")),
    h("p", { class: "quiet" }, t("upload.volume-hint")),
    h("button", { class: "primary", click: () => this.#chooseFiles() }, t("start.choose")),
  );
  readonly #silence = h("p", { class: "notice-line bad", id: "silence", role: "alert", hidden: true });
  /** Says that the study has other heads. */
  readonly #others = h("div", { class: "notice-line remark others", role: "status", hidden: true });
  readonly #closed = h("p", { class: "notice-line bad", id: "closed", role: "note", hidden: true });
  readonly #quality = h("div", { class: "quality", role: "note", hidden: true });
  readonly #layouts: HTMLElement;
  readonly #stage: HTMLElement;
  readonly #main: HTMLElement;
  readonly #sidebar: HTMLElement;
  readonly #list: CaseList;
  readonly #upload: Upload;
  readonly #uploaded = h("p", { id: "upload-done", class: "quiet", role: "status" });
  readonly #root: HTMLElement;
  /** Shows what came from a PACS, if anything has. */
  readonly #arrivals = h(
    "button",
    { id: "arrivals", hidden: true, click: () => this.#showArrivals() },
    t("arrivals.open"),
  );
  /** Who is signed in; hidden where nobody is. */
  readonly #who = h("button", { id: "who", hidden: true });
  readonly #fold = iconButton("panel", t("panel.toggle"), () => {
    choose({ panel: !preferences.peek().panel });
  });
  #viewer: Viewer | null = null;
  /** The layout is not followed any more. */
  #unlaid = (): void => {};
  readonly #ends: readonly (() => void)[];
  #kept: Kept | null;
  #chosen: Case | null = null;
  /** Why the case of the address cannot be shown; empty where it can. */
  #absence = "";
  #routed = 0;
  /** Whether the next key may be the number of a saved layout. */
  #awaitsNumber = false;

  /** `kept` is what draws a case already. */
  constructor(kept: Kept | null) {
    this.#kept = kept;
    this.#list = new CaseList({
      changed: () => void this.route(),
      remove: (one) => void this.#remove(one),
      ready: (one) => {
        announce(t("case.now-ready", { title: caseTitle(one) }));
        void this.#lookForArrivals();
      },
    });
    this.#upload = new Upload(async ({ id }, wasThere) => {
      this.#list.flag(id, t(wasThere ? "case.was-there" : "case.fresh"));
      await this.#list.refresh();
    });
    this.#layouts = choiceOfButtons(
      t("layout.label"),
      LAYOUTS,
      (layout) => t(`layout.${layout}`),
      (layout) => {
        if (this.#viewer) setLayout(this.#viewer.store, layout);
      },
    );
    this.#layouts.className = "layouts";
    for (const [layout, kind] of [
      ["closer", "closer"],
      ["map", "flat-map"],
    ] as const)
      this.#layouts.querySelector(`[value=${layout}]`)?.setAttribute(
        "title",
        keyOf((one) => one.kind === kind),
      );
    this.#stage = h(
      "section",
      { class: "stage", id: "stage", tabindex: -1, "aria-labelledby": "case-title" },
      this.#silence,
      this.#others,
      this.#closed,
      this.#quality,
      this.#note,
      this.#start,
      this.#acquired.element,
    );
    this.#sidebar = h(
      "nav",
      { class: "sidebar", id: "sidebar", "aria-label": t("cases.title") },
      h("h2", {}, t("cases.title")),
      this.#upload.element,
      this.#uploaded,
      this.#arrivals,
      this.#list.element,
    );
    this.#main = h("main", { class: "page" }, this.#sidebar, this.#stage);
    this.#sidebar.append(
      resizer(
        preferences.peek().list_width,
        (width) => this.#main.style.setProperty("--list-width", `${width}px`),
        (list_width) => choose({ list_width }),
      ),
    );
    const bar = this.#header();
    // Where the list lies over the picture, it begins below the bar, which may have several lines.
    new ResizeObserver(() => this.#main.style.setProperty("--bar-height", `${bar.offsetHeight}px`)).observe(bar);
    this.#root = h(
      "div",
      { class: "app" },
      h("a", { class: "skip", href: "#stage", click: (event: MouseEvent) => this.#skip(event) }, t("skip")),
      bar,
      this.#main,
      this.#live,
    );
    document.querySelector(".app")?.remove();
    document.body.append(this.#root);
    this.#ends = [
      effect(() => setText(this.#live, announced.value)),
      effect(() => setText(this.#uploaded, this.#upload.done.value)),
      effect(() => {
        const { panel } = preferences.value;
        this.#main.classList.toggle("no-panel", !panel);
        this.#fold.setAttribute("aria-expanded", String(panel));
      }),
    ];
    // Where the window is narrow, the picture comes first.
    this.#showSidebar(window.innerWidth >= 1200);
    hearDrops(document.body, (files) => {
      this.#showSidebar(true);
      this.#upload.drop(files);
    });
  }

  async start(): Promise<void> {
    await this.#list.refresh();
    document.body.dataset.loaded = "true";
    // Where there is no room beside it, the area for files is in sight alone.
    if (this.#list.cases.length === 0 && window.innerWidth >= BESIDE_PIXELS) {
      this.#showSidebar(true);
      this.#upload.open();
    }
    await this.#lookForArrivals();
    await this.#sayWho();
  }

  /** Says who is signed in. The token without a name is nobody's. */
  async #sayWho(): Promise<void> {
    if (parent !== window) return;
    // Whoever may not look at anything may not ask either.
    const holder = await getHolder().catch(() => ({ name: "anybody", scopes: [] }));
    const name = holder.name === "token" ? t("who.unnamed") : plainName(holder);
    if (name === "anybody") return;
    this.#who.textContent = name;
    this.#who.title = t("who.as", { name });
    this.#who.hidden = false;
    this.#who.onclick = () => holderDialog(name, holder);
  }

  /** Offers the list of what came from a PACS once anything has: of what was refused there is no case. */
  async #lookForArrivals(): Promise<void> {
    if (this.#arrivals.hidden) this.#arrivals.hidden = !(await anyArrivals().catch(() => false));
  }

  #chooseFiles(): void {
    this.#showSidebar(true);
    this.#upload.choose();
  }

  #showArrivals(): void {
    arrivalsDialog((id) => (this.#list.chosen = id));
  }

  /** Leaves what draws the case to the page that comes after this one. */
  dispose(): Kept | null {
    this.#viewer?.settle();
    this.#list.dispose();
    for (const end of this.#ends) end();
    const kept = this.#viewer && { id: this.#viewer.store.shown.id, surface: this.#viewer.release() };
    this.#leave();
    return kept;
  }

  /** Takes the case that is shown away, and remembers how it was left. */
  #leave(): void {
    if (this.#viewer) memory.keep(this.#viewer.store.shown, this.#viewer.store.view.left);
    this.#unlaid();
    this.#viewer?.dispose();
    this.#viewer = null;
  }

  reach(reachable: boolean): void {
    tell(this.#silence, reachable ? "" : t("problem.unreachable"));
    if (!reachable) return;
    void this.#list.refresh();
    this.#viewer?.again();
  }

  /** Shows the case that the address names; without an address the only case there is. */
  async route(): Promise<void> {
    const turn = (this.#routed += 1);
    const address = readAddress(location.hash);
    const id = address.kind === "case" ? address.id : address.kind === "none" ? this.#list.only : null;
    this.#absence = address.kind === "unknown" ? t("address.unknown") : "";
    const chosen = this.#list.cases.find((one) => one.id === id) ?? (id ? await this.#askFor(id) : null);
    // Another address may have come in the meantime.
    if (turn !== this.#routed) return;
    this.#list.mark(id);
    // What was shown without being named keeps its place, whatever else is added.
    if (chosen && address.kind === "none") history.replaceState(null, "", `#${chosen.id}`);
    this.#show(chosen, address.kind === "case" ? address.rest : "");
    // There is something to choose from.
    if (!chosen && this.#list.cases.length > 0) this.#showSidebar(true);
  }

  /** The address was changed by Back, or by hand. */
  async addressChanged(): Promise<void> {
    const before = this.#viewer;
    await this.route();
    const address = readAddress(location.hash);
    const isSame = address.kind === "case" && address.id === before?.store.shown.id;
    if (isSame && before === this.#viewer) before.restore(address.rest);
    // Back and Forward also lead to other patients.
    const viewer = this.#viewer;
    if (
      !before ||
      !viewer ||
      viewer.store.shown.id === before.store.shown.id ||
      viewer.store.shown.id === this.#list.chosen
    )
      return;
    const words = t("address.other", { title: caseIdentity(viewer.store.shown) });
    viewer.store.remark.value = words;
    announce(words);
  }

  #show(chosen: Case | null, rest: string): void {
    this.#chosen = chosen;
    const title = chosen ? caseTitle(chosen) : t("case.none");
    setText(this.#title, title);
    // The label that a user gave, never an identity out of DICOM: the browser's history keeps titles.
    document.title = chosen ? `${caseIdentity(chosen)} · Isocortex` : "Isocortex";
    const ready = chosen?.state === "ready" ? chosen : null;
    tell(this.#note, ready ? "" : chosen ? caseStatus(chosen) : `${this.#absence} ${t("case.choose")}`.trim());
    this.#note.classList.toggle("bad", chosen?.state === "failed");
    this.#layouts.hidden = !ready;
    document.body.classList.toggle("viewing", ready !== null);
    // Where there is nothing to choose from, files are asked for.
    const isEmpty = !chosen && this.#absence === "" && this.#list.isEmpty;
    this.#start.hidden = !isEmpty;
    if (isEmpty) tell(this.#note, "");
    // It may come while the case is open.
    this.#showClosed();
    void this.#acquired.show(ready ? "" : (chosen?.id ?? ""));
    if (ready?.id === this.#viewer?.store.shown.id) return;
    this.#leave();
    // What was said of the case before is not of this one.
    announced.value = "";
    this.#showQuality(ready);
    this.#showOthers(ready?.id);
    const surface = this.#kept && this.#kept.id === ready?.id ? this.#kept.surface : null;
    if (this.#kept && !surface) this.#kept.surface.dispose();
    this.#kept = null;
    if (!ready) return;
    const viewer = new Viewer(ready, {
      rest,
      left: memory.of(ready),
      serverOnly,
      surface,
      made: (one, wasThere) => {
        this.#list.flag(one.id, t(wasThere ? "case.was-there" : "case.fresh"));
        void this.#list.refresh();
      },
    });
    this.#unlaid();
    this.#unlaid = effect(() => {
      const { layout } = viewer.store.view.state.value;
      press(this.#layouts, layout);
      Object.assign(document.body.dataset, { layout, slices: hasSlices({ layout }) });
    });
    this.#viewer = viewer;
    // Where the list lies over the picture, it has been chosen from.
    if (window.innerWidth < BESIDE_PIXELS) this.#showSidebar(false);
    this.#stage.append(viewer.element);
    // Keys are the picture's from now on: in the list, Enter would open another patient.
    if (document.activeElement?.closest("#case-list")) document.getElementById("surface")?.focus();
    this.#main.append(viewer.panel.element);
    void viewer.load();
  }

  /** Says why the case is closed, if it is. */
  #showClosed(): void {
    const closed = this.#chosen?.closed;
    tell(this.#closed, closed ? t(`closed.${closed}.text`) : "");
  }

  /** Of a study with several heads one was opened: the others are a click away. */
  #showOthers(id: string | undefined): void {
    const { others = 0 } = launched ?? {};
    this.#others.hidden = !launched || launched.id !== id;
    if (!launched || this.#others.hidden) return;
    const from = launched;
    const choose = (): void => {
      handOver();
      leaveChoice(from);
    };
    const dismiss = (): void => {
      launched = null;
      this.#others.hidden = true;
    };
    this.#others.replaceChildren(
      h("span", {}, others === 1 ? t("launch.one-other") : t("launch.others", { count: number(others) })),
      h("a", { href: "launch?choose", click: choose }, t("launch.choose")),
      iconButton("close", t("notice.dismiss"), dismiss),
    );
  }

  /** A warning before a picture whose sides or mask are doubtful. */
  #showQuality(ready: (Case & { state: "ready" }) | null): void {
    const quality = ready && qualityOf(ready);
    const doubts = quality ? doubtsOf(quality) : [];
    this.#quality.hidden = doubts.length === 0;
    if (!ready || !quality || doubts.length === 0) return;
    this.#quality.dataset.verdict = quality.state;
    this.#quality.replaceChildren(
      ...doubts.flatMap((doubt) => [
        h("strong", { class: "quality-badge", "data-verdict": quality.state }, t(`quality.${doubt}`)),
        h("span", {}, t(`quality.${doubt}.text`)),
      ]),
      h("button", { click: () => maskDialog(ready.id) }, t("quality.look")),
      h("ul", {}, ...reasonWords(quality).map((reason) => h("li", {}, reason))),
    );
  }

  #header(): HTMLElement {
    const language = choice(
      "language",
      t("language"),
      Object.keys(LANGUAGES).filter(isLanguage),
      (one) => LANGUAGES[one],
      (one) => choose({ language: one }),
    );
    language.value = preferences.peek().language;
    for (const option of language.options) option.lang = option.value;
    return h(
      "header",
      { class: "bar" },
      iconButton("menu", t("cases.toggle"), () => this.#showSidebar(Boolean(this.#sidebar.hidden))),
      h("h1", {}, "Isocortex"),
      this.#title,
      this.#layouts,
      // Leads to where another case stands beside the one that is shown.
      h("a", { href: "compare", click: handOver }, t("compare.open")),
      h("p", { class: "research", role: "note" }, t("notice.long")),
      language,
      iconButton("theme", t("theme.toggle"), () =>
        choose({ theme: preferences.peek().theme === "dark" ? "light" : "dark" }),
      ),
      ...(document.fullscreenEnabled ? [iconButton("full", t("full-screen"), () => void toggleFullScreen())] : []),
      this.#who,
      this.#fold,
      iconButton("help", t("help.title"), () => this.#help()),
    );
  }

  #showSidebar(shown: boolean): void {
    this.#sidebar.hidden = !shown;
    this.#main.classList.toggle("with-sidebar", shown);
    this.#root.querySelector(".bar .icon-button")?.setAttribute("aria-expanded", String(shown));
  }

  #skip(event: MouseEvent): void {
    // The address is the state's: the link moves the focus alone.
    event.preventDefault();
    this.#stage.focus();
  }

  #help(): void {
    helpDialog(preferences.peek(), choose);
  }

  /** A case that the list does not hold (yet): null where there is none. */
  async #askFor(id: string): Promise<Case | null> {
    try {
      return await getCase(id);
    } catch (problem) {
      this.#absence = problemWords(problem);
      return null;
    }
  }

  async #remove(one: Case): Promise<void> {
    try {
      if (!(await confirmDelete(t("delete.title"), t("delete.text", { title: caseIdentity(one) })))) return;
      await deleteCase(one.id);
      memory.forget(one.id);
      if (this.#chosen?.id === one.id) history.replaceState(null, "", location.pathname + location.search);
      this.#list.forget(one.id);
      await this.#list.refresh();
      announce(t("delete.done"));
      // The button that had the focus is gone.
      if (document.activeElement === document.body) this.#stage.focus();
    } catch (problem) {
      tell(this.#note, problemWords(problem));
    }
  }

  /** What a key did while it was held is over. */
  release(): void {
    if (this.#viewer) perform(this.#viewer.store, { kind: "release" });
  }

  /** A key that is no one else's. */
  key(event: KeyboardEvent): void {
    // Dialogs are children of the body: looking through a thousand findings for one would take longer than a frame has.
    const isCovered = [...document.body.children].some((one) => one.matches("dialog[open]"));
    if (event.defaultPrevented || !(event.target instanceof HTMLElement) || isCovered) return;
    const onPicture = event.target.closest(".pane.surface") !== null;
    const hasModifier = event.ctrlKey || event.metaKey;
    // Where text is typed, undoing is the text's.
    const typed = "input:not([type=range], [type=checkbox]), textarea";
    const ofField = event.target.closest(hasModifier ? typed : `${typed}, select`);
    if (!onPicture && (ofField || !(hasModifier || preferences.peek().shortcuts))) return;
    const command = (this.#awaitsNumber && recallOf(event)) || commandOf(event);
    // A key that is held with another one is not the one that was awaited.
    if (event.key !== "Shift") this.#awaitsNumber = command?.kind === "layouts";
    if (!command) return;
    // A button or a link is worked by these; a page is scrolled.
    const ofControl =
      event.target.closest("button, a, summary, input") !== null && (event.key === " " || event.key === "Enter");
    const scrolls = event.target.closest("#sidebar, .candidates") ? /^(Arrow|Page)/ : /^Arrow/;
    const ofPage = !onPicture && (scrolls.test(event.key) || event.key === "Enter");
    if (ofControl || ofPage) return;
    if (command.kind !== "help" && !this.#viewer) return;
    event.preventDefault();
    if (command.kind === "help") this.#help();
    else if (this.#viewer) perform(this.#viewer.store, command);
  }
}

let app: App | null = null;

function toggleFullScreen(): Promise<void> {
  return document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
}

const language = computed(() => preferences.value.language);

/** Builds the page, again for each language: its state is in the address. */
async function build(spoken: Language): Promise<void> {
  await learn(spoken);
  document.documentElement.lang = spoken;
  const isFirst = app === null;
  app = new App(app?.dispose() ?? null);
  if (!isFirst) document.getElementById("language")?.focus();
  void app.start();
}

effect(() => void (document.documentElement.dataset.theme = preferences.value.theme));
onTokenWanted(askToken);
onReach((reachable) => app?.reach(reachable));
window.addEventListener("popstate", () => void app?.addressChanged());
window.addEventListener("keydown", (event) => app?.key(event));
for (const name of ["keyup", "blur"]) window.addEventListener(name, () => app?.release());
effect(() => void build(language.value));
