// What stands around the pictures of a case: the bar, the list, what there is to know of the case, and its controls.

import { useLayoutEffect, useRef, useState } from "preact/hooks";

import { getPicture, handOver, plainName } from "../base/api.ts";
import { caseStatus, caseTitle } from "../base/case-words.ts";
import { number, t } from "../base/i18n.ts";
import { keyOf } from "../model/keys.ts";
import { PLANE_NAMES, type Plane } from "../model/space.ts";
import { LAYOUTS } from "../model/state.ts";
import { listAddress } from "../model/worklist.ts";
import { announced } from "../store/announce.ts";
import { perform, setLayout } from "../store/commands.ts";
import { holder, mayWrite } from "../store/holder.ts";
import { choose, preferences } from "../store/preferences.ts";
import type { App } from "./app.ts";
import { arrivalsDialog } from "./arrivals.tsx";
import { CaseList } from "./cases.tsx";
import { helpDialog, holderDialog } from "./dialogs.tsx";
import { Button, Buttons, IconButton, Placed, Remark } from "./fields.tsx";
import { Panel } from "./panel.tsx";
import { maskDialog, useDrawn } from "./server-picture.tsx";
import { settingsDialog } from "./settings.tsx";
import { UploadForm } from "./upload.tsx";
import { Verdict } from "./notices.tsx";
import type { Viewer } from "./viewer.tsx";

interface OfApp {
  readonly app: App;
}

export function Frame({ app }: OfApp) {
  const { panel } = preferences.value;
  const hasList = app.hasList.value;
  const viewer = app.viewer.value;
  const isList = app.isStart.value && !app.cases.isEmpty.value;
  const [barHeight, setBarHeight] = useState(0);
  const bar = useRef<HTMLElement>(null);
  // Where the list lies over the picture, it begins below the bar, which may have several lines.
  useLayoutEffect(() => {
    const resized = new ResizeObserver(() => setBarHeight(bar.current?.offsetHeight ?? 0));
    if (bar.current) resized.observe(bar.current);
  }, []);
  return (
    <>
      <a
        class="skip"
        href="#stage"
        onClick={(event) => {
          // The address is the state's: the link moves the focus alone.
          event.preventDefault();
          document.getElementById("stage")?.focus();
        }}
      >
        {t("skip")}
      </a>
      <header class="bar" ref={bar}>
        <Bar app={app} />
      </header>
      <main
        class={["page", hasList && "with-sidebar", !(panel && viewer) && "no-panel", isList && "list-alone"]
          .filter(Boolean)
          .join(" ")}
        style={{ "--bar-height": `${barHeight}px` }}
      >
        <nav class="sidebar" id="sidebar" aria-label={t("cases.title")} hidden={!hasList}>
          <h2>{t("cases.title")}</h2>
          {mayWrite.value && <UploadForm upload={app.upload} />}
          <p id="upload-done" class="quiet" role="status">
            {app.upload.done}
          </p>
          {app.hasArrivals.value && (
            <Button id="arrivals" onClick={() => arrivalsDialog((id) => (app.cases.chosen = id))}>
              {t("arrivals.open")}
            </Button>
          )}
          <CaseList app={app} />
        </nav>
        <section class="stage" id="stage" tabIndex={-1} aria-labelledby="case-title">
          <Stage app={app} />
        </section>
        {viewer && (
          <Panel
            key={viewer.store.shown.id}
            store={viewer.store}
            made={(one, wasThere) => void app.made(one, wasThere)}
            onScreen={() => viewer.onScreen}
          />
        )}
        {viewer?.store.isAlone.value && (
          <IconButton
            icon="close"
            label={t("close")}
            class="icon-button leave-alone"
            onClick={() => perform(viewer.store, { kind: "alone" })}
          />
        )}
      </main>
      <div class="visually-hidden" id="live" role="status" aria-live="polite">
        {announced}
      </div>
    </>
  );
}

function Bar({ app }: OfApp) {
  const { panel } = preferences.value;
  const chosen = app.chosen.value;
  const store = app.viewer.value?.store;
  const reader = holder.value;
  // The token without a name is nobody's.
  const isUnnamed = reader?.name === "token";
  const name = reader && (isUnnamed ? t("who.unnamed") : plainName(reader));
  const toggleFullScreen = (): Promise<void> =>
    document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen();
  return (
    <>
      {/* Where the list has all the room, there is nothing to make room for. */}
      {!app.isStart.value && (
        <IconButton
          icon="menu"
          label={t("cases.toggle")}
          aria-expanded={String(app.hasList.value)}
          onClick={() => choose({ list: !app.hasList.peek() })}
        />
      )}
      <h1>Isocortex</h1>
      {chosen && (
        <a id="to-list" href={listAddress(app.cases.filter.value)}>
          {t("cases.title")}
        </a>
      )}
      <h2 id="case-title">{chosen ? caseTitle(chosen) : t("cases.title")}</h2>
      {store && (
        <Buttons
          name="layouts"
          label={t("layout.label")}
          values={LAYOUTS}
          value={store.view.state.value.layout}
          words={(layout) => t(`layout.${layout}`)}
          about={(layout) => {
            const kind = { closer: "closer", map: "flat-map" }[String(layout)];
            return kind ? { title: keyOf((one) => one.kind === kind) } : {};
          }}
          onChoose={(layout) => setLayout(store, layout)}
        />
      )}
      {/* Leads to where another case stands beside the one that is shown. */}
      <a href="compare" onClick={handOver}>
        {t("compare.open")}
      </a>
      <p class="research" role="note">
        {t("notice.long")}
      </p>
      {document.fullscreenEnabled && (
        <IconButton icon="full" label={t("full-screen")} onClick={() => void toggleFullScreen()} />
      )}
      {reader && name && name !== "anybody" && (
        <Button id="who" title={t("who.as", { name })} onClick={() => holderDialog(name, reader)}>
          {name}
        </Button>
      )}
      {store && (
        <IconButton
          icon="panel"
          label={t("panel.toggle")}
          aria-expanded={String(panel)}
          onClick={() => choose({ panel: !panel })}
        />
      )}
      <IconButton icon="settings" id="settings" label={t("settings.title")} onClick={() => settingsDialog(store)} />
      <IconButton icon="help" label={t("help.title")} onClick={helpDialog} />
    </>
  );
}

/** What there is to know of the chosen case, and its pictures. */
function Stage({ app }: OfApp) {
  const chosen = app.chosen.value;
  const viewer = app.viewer.value;
  const absence = app.absence.value;
  const closed = chosen?.closed;
  const isReady = chosen?.state === "ready";
  // Where there is nothing to choose from, files are asked for.
  const isEmpty = !chosen && absence === "" && app.cases.isEmpty.value;
  const choice = absence || isEmpty ? `${absence} ${t("case.choose")}`.trim() : "";
  const note = isReady ? absence : chosen ? caseStatus(chosen) : choice;
  return (
    <>
      <p class="notice-line bad" id="silence" role="alert" hidden={!app.isSilent.value}>
        {app.isSilent.value && t("problem.unreachable")}
      </p>
      <Others app={app} />
      {closed && (
        <p class="notice-line bad" id="closed" role="note">
          {t(`closed.${closed}.text`)}
        </p>
      )}
      {chosen?.trashed && (
        <p class="notice-line" id="in-trash" role="note">
          {t("trash.open")}{" "}
          {mayWrite.value && <Button onClick={() => void app.trash(chosen, false)}>{t("trash.take-out")}</Button>}
        </p>
      )}
      {viewer && (
        <Verdict quality={viewer.store.shown.quality}>
          <Button onClick={() => maskDialog(viewer.store.shown.id)}>{t("quality.look")}</Button>
        </Verdict>
      )}
      <p
        id="case-note"
        class={chosen?.state === "failed" ? "stage-note bad" : "stage-note"}
        role="status"
        hidden={note === "" || (isEmpty && mayWrite.value) || !app.cases.isListed.value}
      >
        {note}
      </p>
      {isEmpty && mayWrite.value && (
        <div class="start">
          <p>{t("start.drop")}</p>
          <p class="quiet">{t("upload.volume-hint")}</p>
          <Button class="primary" onClick={() => app.chooseFiles()}>
            {t("start.choose")}
          </Button>
        </div>
      )}
      {/* What was acquired, of a case that has nothing else to show yet. */}
      {chosen && !isReady && (
        <div class="acquired">
          {PLANE_NAMES.map((plane) => (
            <Acquired key={`${chosen.id}-${plane}`} id={chosen.id} plane={plane} />
          ))}
        </div>
      )}
      {viewer && <Pictures key={viewer.store.shown.id} viewer={viewer} />}
    </>
  );
}

function Pictures({ viewer }: { readonly viewer: Viewer }) {
  useLayoutEffect(() => {
    // Keys are the picture's from now on: in the list, Enter would open another patient.
    if (document.activeElement?.closest("#case-list")) document.getElementById("surface")?.focus();
    void viewer.load();
  }, []);
  return <Placed node={viewer.element} />;
}

function Acquired({ id, plane }: { readonly id: string; readonly plane: Plane }) {
  const drawn = useDrawn(id, () => getPicture(`${id}/acquired/${plane}?annotate=true`));
  // Without a picture there are still the words.
  return drawn instanceof HTMLImageElement ? <Placed node={drawn} alt={t(`plane.${plane}`)} /> : null;
}

/** Of a study with several heads one was opened: the others are a click away. */
function Others({ app }: OfApp) {
  const launched = app.launched.value;
  if (!launched || launched.id !== app.viewer.value?.store.shown.id) return null;
  const { others: count } = launched;
  return (
    <Remark name="others" dismiss={() => (app.launched.value = null)}>
      <span>{count === 1 ? t("launch.one-other") : t("launch.others", { count: number(count) })}</span>
      <a href="launch?choose" onClick={() => app.chooseHead()}>
        {t("launch.choose")}
      </a>
    </Remark>
  );
}
