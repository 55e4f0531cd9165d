// A case in one file: the page reduced to looking, without a server.

import { effect } from "@preact/signals";
import { render } from "preact";
import { useLayoutEffect } from "preact/hooks";

import { ask, carryBy, getCase } from "../base/api.ts";
import { caseIdentity } from "../base/case-words.ts";
import { h } from "../base/dom.ts";
import { gyrusWords, isLanguage, learn, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { ReadyCase } from "../model/case.ts";
import type { Command } from "../model/controls.ts";
import { type Finding, middleOf, numbered } from "../model/findings.ts";
import { readAddress } from "../model/fragment.ts";
import { commandOf } from "../model/keys.ts";
import { ViewMemory } from "../model/memory.ts";
import { sideOf } from "../model/midsagittal.ts";
import { type Layout, type ViewState, firstState, hasSlices } from "../model/state.ts";
import { Button, Buttons, type OfStore, Placed, Quiet } from "../page/fields.tsx";
import { Verdict } from "../page/notices.tsx";
import { ViewSection } from "../page/view-section.tsx";
import { Viewer } from "../page/viewer.tsx";
import { announced } from "../store/announce.ts";
import { goToRow } from "../store/bring.ts";
import { perform, setLayout } from "../store/commands.ts";
import { preferences } from "../store/preferences.ts";
import { type About, answered, readAbout } from "./answers.ts";

const LOOKING_LAYOUTS = ["single", "slices", "mirror", "both"] as const satisfies readonly Layout[];

/** The commands that look, and neither write nor ask for more than the file has. */
const LOOKING: ReadonlySet<Command["kind"]> = new Set([
  "depth",
  "turn",
  "pan",
  "zoom",
  "view",
  "surface",
  "window",
  "invert",
  "reset",
  "play",
  "mark",
  "outline",
  "hold",
  "leave",
  "undo",
  "redo",
]);

function Frame({ viewer, about }: { readonly viewer: Viewer; readonly about: About }) {
  const { store } = viewer;
  const { shown } = store;
  const { bits, extent } = about.volume;
  const lacks = [extent === "envelope" && t("share.cropped"), bits === 8 && t("share.coarse")].filter(Boolean);
  useLayoutEffect(() => void viewer.load(), []);
  return (
    <>
      <header class="bar">
        <h1>Isocortex</h1>
        <h2 id="case-title">{caseIdentity(shown)}</h2>
        <Buttons
          name="layouts"
          label={t("layout.label")}
          values={LOOKING_LAYOUTS}
          value={store.view.state.value.layout as (typeof LOOKING_LAYOUTS)[number]}
          words={(layout) => t(`layout.${layout}`)}
          onChoose={(layout) => setLayout(store, layout)}
        />
        <p class="research" role="note">
          {t("notice.long")}
        </p>
      </header>
      <main class="page">
        <section class="stage" id="stage" tabIndex={-1} aria-labelledby="case-title">
          {shown.closed && (
            <p class="notice-line bad" id="closed" role="note">
              {t(`closed.${shown.closed}.text`)}
            </p>
          )}
          <p class="notice-line" id="lacks" role="note" hidden={lacks.length === 0}>
            {lacks.join(" ")}
          </p>
          <Verdict quality={shown.quality} />
          <Placed node={viewer.element} />
        </section>
        <aside class="panel" aria-label={t("panel.label")}>
          <Findings store={store} />
          <ViewSection store={store} />
          <Report />
        </aside>
      </main>
      <div class="visually-hidden" id="live" role="status" aria-live="polite">
        {announced}
      </div>
    </>
  );
}

/** The findings that were kept, each of which leads to its place. */
function Findings({ store }: OfStore) {
  const { findings, rows, shown } = store;
  const kept = numbered(findings.list.value);
  return (
    <details class="group findings" open>
      <summary>{t("share.findings")}</summary>
      <div class="group-body">
        <Quiet>{kept.length === 0 ? t("share.no-findings") : ""}</Quiet>
        <ol class="rows">
          {kept.map((finding, at) => {
            const row = rows.all.value.find((one) => one.finding?.id === finding.id);
            const side = finding.side ?? sideOf(middleOf(finding), shown.midsagittal);
            return (
              <li
                key={finding.id}
                data-id={finding.id}
                data-judgement="kept"
                aria-current={row !== undefined && rows.open.value === row}
              >
                <Button class="row-button" onClick={() => row && goToRow(store, row)}>
                  <span class="dot" style={{ borderColor: finding.colour }}>
                    {number(at + 1)}
                  </span>
                  <span class="row-title">{`${t(`side.${side}`)} ${gyrusWords(finding.gyrus)}`.trimEnd()}</span>
                  <span class="row-depth">{`${number(finding.depth_mm, 1)} mm`}</span>
                  <span class={finding.is_unconfirmed ? "doubtful row-about" : "row-about"} dir="auto">
                    {[finding.is_unconfirmed && t("findings.unconfirmed"), finding.label].filter(Boolean).join(" · ")}
                  </span>
                </Button>
                {finding.note && (
                  <p class="row-details quiet" dir="auto">
                    {finding.note}
                  </p>
                )}
              </li>
            );
          })}
        </ol>
      </div>
    </details>
  );
}

/** The words of the report, which the server has written into the file. */
function Report() {
  const template = document.querySelector<HTMLTemplateElement>("template#report");
  return (
    <details class="group report" open>
      <summary>{t("share.report")}</summary>
      {template && <Placed node={h("div", { class: "group-body" }, template.content.cloneNode(true))} />}
    </details>
  );
}

/** A key does what it does on the page, unless a control takes it. */
function hearKeys({ store }: Viewer): void {
  let isHeld = false;
  window.addEventListener("keydown", (event) => {
    const target = event.target;
    if (event.defaultPrevented || !(target instanceof HTMLElement)) return;
    const onPicture = target.closest(".pane.surface") !== null;
    const ofControl = target.closest("input") ?? (/^( |Enter)$/.test(event.key) && target.closest("button, summary"));
    if (!onPicture && (ofControl || /^(Arrow|Page|Enter)/.test(event.key))) return;
    const command = commandOf(event);
    if (!command || !LOOKING.has(command.kind)) return;
    event.preventDefault();
    perform(store, command);
    isHeld ||= command.kind === "hold";
  });
  for (const name of ["keyup", "blur"])
    window.addEventListener(name, () => {
      if (isHeld) perform(store, { kind: "release" });
      isHeld = false;
    });
}

/** What the address of the page says of a view holds in the file as well, as far as the file has it. */
function restOf(shown: ReadyCase): string {
  const address = readAddress(location.hash);
  return address.kind === "case" && address.id === shown.id ? address.rest : "";
}

/** A state without what only a server has, and what the file has no control for. */
function keptToFile(state: ViewState, shown: ReadyCase): ViewState {
  const layout = LOOKING_LAYOUTS.find((one) => one === state.layout) ?? "both";
  const { panes, layer, overlay, beside, plane, swipe, has_edges, across_deg, way, window } = firstState(shown);
  const kept = { ...state, panes, layer, overlay, beside, plane, swipe, has_edges, across_deg, way, layout };
  // The window of a layer is none of the intensities.
  return state.layer ? { ...kept, window } : kept;
}

/** The first finding, which the file begins with if its address asks for nothing. */
async function firstFinding(id: string): Promise<string> {
  const { findings } = await ask<{ readonly findings: readonly Finding[] }>(`v1/cases/${id}/findings`);
  return numbered(findings)[0]?.id ?? "";
}

async function show(shown: ReadyCase, about: About, place: HTMLElement): Promise<void> {
  const left = new ViewMemory().of(shown);
  const keep = (state: ViewState): ViewState => keptToFile(state, shown);
  const rest = restOf(shown);
  const viewer = new Viewer(shown, {
    rest,
    finding: rest === "" ? await firstFinding(shown.id) : "",
    left,
    serverOnly: false,
    shared: about.volume,
    keep,
  });
  const { store } = viewer;
  window.addEventListener("popstate", () =>
    viewer.restore({ kind: "case", id: shown.id, rest: restOf(shown), finding: "" }),
  );
  store.patient.value = about.patient;
  if (!about.has_parts) store.refusal.value = t("share.no-parts");
  effect(() => {
    const state = store.view.state.value;
    Object.assign(document.body.dataset, { layout: state.layout, slices: hasSlices(state) });
  });
  document.title = `${caseIdentity(shown)} · Isocortex`;
  render(<Frame viewer={viewer} about={about} />, place);
  hearKeys(viewer);
}

const about = readAbout();
carryBy("", (path) => answered(about.id, path));
const language = isLanguage(about.language) ? about.language : "en";
await learn(language);
document.documentElement.lang = language;
document.documentElement.dataset.theme = preferences.peek().theme;
const place = h("div", { class: "app" });
document.body.append(place);
try {
  const shown = await getCase(about.id);
  if (shown.state === "ready") await show(shown, about, place);
} catch (problem) {
  render(<Quiet>{problemWords(problem)}</Quiet>, place);
}
