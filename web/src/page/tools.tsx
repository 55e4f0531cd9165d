// The strip of tools over the pictures: what hands do there, what lies over them, and what is saved of them.

import { useState } from "preact/hooks";

import type { Icon as IconName } from "../base/dom.ts";
import { type Key, t } from "../base/i18n.ts";
import type { Command } from "../model/controls.ts";
import { keyOf } from "../model/keys.ts";
import { MAP_NAMES, type MapName, isLayerId, isMap } from "../model/maps.ts";
import { allLayersOf, hasSlices } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import {
  type OnScreen,
  copied,
  copyPicture,
  findingsStl,
  saveCut,
  savePicture,
  saveShared,
  saveWithFindings,
} from "./export.ts";
import {
  Button,
  Buttons,
  Choice,
  Icon,
  IconButton,
  Menu,
  type OfStore,
  Quiet,
  Row,
  Status,
  Ticked,
} from "./fields.tsx";
import { Comparison, OverlayControls, WindowControls } from "./look-controls.tsx";
import { RulerControls } from "./measures-section.tsx";
import { seriesDialog } from "./series.tsx";
import { serverPictureDialog } from "./server-picture.tsx";

interface Face {
  readonly icon: IconName;
  /** What stands on it, and where that is short, what it does. */
  readonly words: Key;
  readonly about?: Key;
  readonly isOn?: boolean;
  /** The key that does the same. */
  readonly letter?: string;
}

/** How a tool looks: its icon, its word, and in its tip what it does and by which key. */
const faceOf = ({ icon, words, about = words, isOn, letter }: Face) => ({
  class: "tool",
  title: letter ? `${t(about)} (${letter})` : t(about),
  "aria-label": t(about),
  ...(letter && { "aria-keyshortcuts": letter }),
  ...(isOn !== undefined && { "aria-pressed": isOn }),
  children: [<Icon name={icon} />, <span>{t(words)}</span>],
});

const Tool = ({ onClick, ...face }: Face & { onClick(): void }) => (
  <button type="button" {...faceOf(face)} onClick={onClick} />
);

export function Tools({ store, onScreen }: OfStore & { onScreen(): OnScreen }) {
  const { measures, findings, view, caseLayers, isBare, hasHand } = store;
  const state = view.seen.value;
  const ofKind = (kind: Command["kind"]): string => keyOf((command) => command.kind === kind);
  const ofMap = (name: MapName): string => keyOf((command) => command.kind === "map" && command.name === name);
  const hasFlair = caseLayers.list.value?.layers.some(({ id }) => id === "flair") ?? false;
  const menu = (name: string, { children, ...face }: ReturnType<typeof faceOf>) => ({
    name,
    button: children,
    ...face,
  });
  const map = (name: "blur" | "flair") => (
    <Tool
      icon={name}
      words={`tool.${name}`}
      about={`map.${name}`}
      isOn={state.overlay?.name === name}
      letter={ofMap(name)}
      onClick={() => perform(store, { kind: "map", name })}
    />
  );
  const canUndo = view.canUndo.value || findings.canUndo.value;
  const canRedo = view.canRedo.value || findings.canRedo.value;
  const isMeasuring = measures.tool.value !== null;
  /** What a drag does, when the ruler is laid down. */
  const take = (isHand: boolean): void => {
    measures.choose(null);
    hasHand.value = isHand;
  };
  return (
    <div class="tools" role="group" aria-label={t("tool.label")}>
      <Tool
        icon="point"
        words="tool.point"
        about="tool.point.about"
        isOn={!isMeasuring && !hasHand.value}
        onClick={() => take(false)}
      />
      <Tool
        icon="move"
        words="tool.move"
        about="tool.move.about"
        isOn={store.moves.value}
        onClick={() => take(!store.moves.peek())}
      />
      <Menu {...menu("window", faceOf({ icon: "window", words: "panel.window" }))}>
        <WindowControls store={store} />
      </Menu>
      <Menu
        {...menu(
          "ruler",
          faceOf({ icon: "ruler", words: "panel.measure", isOn: isMeasuring, letter: ofKind("ruler") }),
        )}
      >
        <RulerControls store={store} />
      </Menu>
      <Tool
        icon="across"
        words="tool.across"
        about="across.show"
        isOn={state.across_deg !== null && hasSlices(state)}
        letter={ofKind("across")}
        onClick={() => perform(store, { kind: "across" })}
      />
      <Tool
        icon="hide"
        words="tool.hide"
        about="tool.hide.about"
        isOn={isBare.value}
        letter={ofKind("hold")}
        onClick={() => perform(store, { kind: isBare.peek() ? "release" : "hold" })}
      />
      <hr />
      {map("blur")}
      {hasFlair && map("flair")}
      <Menu {...menu("maps", faceOf({ icon: "more", words: "tool.more", about: "map.more" }))}>
        <Maps store={store} hasFlair={hasFlair} letterOf={ofMap} />
      </Menu>
      <Tool
        icon="series"
        words="tool.series"
        about="strip.show"
        isOn={store.isStripShown.value}
        letter={ofKind("strip")}
        onClick={() => perform(store, { kind: "strip" })}
      />
      <hr class="spring" />
      {(["undo", "redo"] as const).map((kind) => (
        <IconButton
          key={kind}
          icon={kind}
          label={t(kind)}
          class="icon-button tool"
          disabled={kind === "undo" ? !canUndo : !canRedo}
          onClick={() => perform(store, { kind })}
        />
      ))}
      <Menu {...menu("export", faceOf({ icon: "export", words: "tool.export", about: "tool.export.about" }))}>
        <Export store={store} onScreen={onScreen} />
      </Menu>
    </div>
  );
}

function Maps({
  store,
  hasFlair,
  letterOf,
}: OfStore & { readonly hasFlair: boolean; letterOf(name: MapName): string }) {
  const { overlay } = store.view.seen.value;
  const map = overlay && isMap(overlay.name) ? overlay.name : null;
  return (
    <div class="maps">
      <Buttons
        label={t("map.label")}
        values={["none", ...MAP_NAMES]}
        value={overlay ? map : "none"}
        words={(name) => t(`map.${name}`)}
        about={(name) => ({
          // It is offered only if there is such a layer.
          hidden: name === "flair" && !hasFlair,
          title: name === "none" ? "" : letterOf(name),
        })}
        onChoose={(name) => {
          if (name === "none") store.changeLook({ overlay: null }, true);
          else if (map !== name) perform(store, { kind: "map", name });
        }}
      />
      {map && <Quiet>{t(`map.${map}.about`)}</Quiet>}
      {!allLayersOf(store.view.state.value).some(isLayerId) && <Comparison store={store} />}
      <OverlayControls store={store} isOfMap />
    </div>
  );
}

/** How many times the screen's pixels a saved picture can have. */
const TIMES = [1, 2, 4] as const;
type Times = (typeof TIMES)[number];

function Export({ store, onScreen }: OfStore & { onScreen(): OnScreen }) {
  const [times, setTimes] = useState<Times>(1);
  const [note, say] = useState("");
  const [isNamed, setNamed] = useState(false);
  /** Reports in words what becomes of a file. */
  const telling = (words: string, work: () => Promise<string>) => (
    <Button
      onClick={() => {
        say(t("export.working"));
        void work().then(say);
      }}
    >
      {words}
    </Button>
  );
  const copyAddress = (): Promise<string> => {
    store.view.rest();
    return copied(location.href);
  };
  return (
    <>
      <Row>
        <Choice
          id="times"
          label={t("export.times")}
          values={TIMES}
          value={times}
          words={(one) => `${one}×`}
          onChoose={(one) => setTimes(one)}
        />
        {telling(t("export.screenshot"), () => savePicture(onScreen(), times))}
        {telling(t("export.copy-picture"), () => copyPicture(onScreen(), times))}
        <Button onClick={() => serverPictureDialog(onScreen())}>{t("export.server")}</Button>
        <Button onClick={() => seriesDialog(onScreen(), store.sweep.choice.peek())}>{t("export.series")}</Button>
        {telling(t("export.copy"), copyAddress)}
        <Button
          title={keyOf(({ kind }) => kind === "alone")}
          onClick={() => {
            // Otherwise Escape would close this menu first.
            document.getElementById("menu-export")?.hidePopover();
            perform(store, { kind: "alone" });
          }}
        >
          {t("alone.show")}
        </Button>
      </Row>
      <Row>
        {telling(t("export.share"), () => saveShared(store, isNamed))}
        {store.shown.links?.dicom && (
          <Ticked id="share-patient" words={t("findings.patient")} checked={isNamed} onTick={setNamed} />
        )}
      </Row>
      <Quiet>{t("export.share.about")}</Quiet>
      <Row>
        {telling(t("export.cut"), () => saveCut(onScreen()))}
        {telling(t("export.findings"), () => saveWithFindings(store, "-findings.stl", () => findingsStl(store.shown)))}
      </Row>
      <Quiet>{t("export.stl.about")}</Quiet>
      <Status words={note} />
    </>
  );
}
