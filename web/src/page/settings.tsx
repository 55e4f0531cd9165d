// What can be chosen once, in one place: of the page, of hands and keys, of slices and of the sweep.

import { useState } from "preact/hooks";

import { type Key, LANGUAGES, isLanguage, number, t } from "../base/i18n.ts";
import { DRAG_DIRECTIONS, WHEEL_USES } from "../model/controls.ts";
import { readDepths } from "../model/query.ts";
import { CONVENTIONS, boundOutlines, clampDepth } from "../model/state.ts";
import { SWEEP_SPEEDS, type SweepChoice } from "../model/sweep.ts";
import { THEMES, choose, preferences } from "../store/preferences.ts";
import type { Store } from "../store/store.ts";
import { open } from "./dialogs.tsx";
import { LabelledChoice, Line, type OfStore, Ticked, Typed } from "./fields.tsx";

/** What is chosen by a word; the colours of the page come first. */
const CHOICES: readonly (readonly ["theme" | "wheel" | "drag", readonly string[]])[] = [
  ["theme", THEMES],
  ["wheel", WHEEL_USES],
  ["drag", DRAG_DIRECTIONS],
];

/** Shows the settings; those of slices and of the sweep if a case is open. */
export function settingsDialog(store: Store | undefined): void {
  void open(
    t("settings.title"),
    "settings",
    <>
      <OfPage />
      {store && <OfSlices store={store} />}
      {store && <OfSweep store={store} />}
    </>,
  );
}

function OfPage() {
  // In a frame, language and colours are those of the page around it.
  const isOwn = parent === window;
  return (
    <>
      {isOwn && (
        <LabelledChoice
          isInline
          id="language"
          label={t("language")}
          values={Object.keys(LANGUAGES).filter(isLanguage)}
          value={preferences.value.language}
          words={(one) => LANGUAGES[one]}
          onChoose={(language) => choose({ language })}
        />
      )}
      {CHOICES.slice(isOwn ? 0 : 1).map(([name, values]) => (
        <LabelledChoice
          key={name}
          isInline
          id={name}
          label={t(`${name}.label`)}
          values={values}
          value={preferences.value[name]}
          words={(one) => t(`${name}.${one}` as Key)}
          onChoose={(one) => choose({ [name]: one })}
        />
      ))}
      <Tick name="shortcuts" />
    </>
  );
}

const Tick = ({ name }: { readonly name: "shortcuts" | "linked_zoom" }) => (
  <Ticked
    id={name}
    words={t(`${name}.label`)}
    checked={preferences.value[name]}
    onTick={(isTicked) => choose({ [name]: isTicked })}
  />
);

function OfSlices({ store }: OfStore) {
  return (
    <>
      <h3>{t("convention.label")}</h3>
      <LabelledChoice
        isInline
        id="convention"
        label={t("settings.convention")}
        values={CONVENTIONS}
        value={store.view.state.value.convention}
        words={(name) => t(`convention.${name}`)}
        onChoose={(name) => store.change({ convention: name }, true)}
      />
      <Tick name="linked_zoom" />
      <Outlines store={store} />
    </>
  );
}

/** The depths whose outlines slices show. */
function Outlines({ store }: OfStore) {
  const [isUnread, setUnread] = useState(false);
  return (
    <Line label={t("outlines.label")}>
      <Typed
        id="outlines"
        inputMode="decimal"
        placeholder="0, 20"
        aria-label={t("outlines.label")}
        aria-invalid={isUnread}
        value={store.view.state.value.outlines_mm.join(", ")}
        onLeave={(typed) => {
          const depths = typed.trim() ? readDepths(typed, clampDepth(Infinity, store.shown)) : [];
          // What cannot be read stays to be corrected, and changes nothing.
          setUnread(!depths);
          if (!depths) return typed;
          const bound = boundOutlines(depths, store.shown);
          store.change({ outlines_mm: bound }, true);
          return bound.join(", ");
        }}
      />
      <span class="quiet">mm</span>
    </Line>
  );
}

/** What a sweep goes through, how fast, and whether it comes back. */
function OfSweep({ store: { sweep } }: OfStore) {
  const choice = sweep.choice.value;
  const set = (change: Partial<SweepChoice>): void => sweep.choose({ ...choice, ...change });
  const end = (id: string, label: string, which: "from_mm" | "to_mm") => (
    <input
      type="number"
      id={id}
      min={0}
      step={0.5}
      aria-label={label}
      value={choice[which]}
      onChange={({ currentTarget }) => {
        set({ [which]: currentTarget.valueAsNumber });
        // What was typed may be out of range.
        currentTarget.value = String(sweep.choice.peek()[which]);
      }}
    />
  );
  return (
    <>
      <h3>{t("panel.sweep")}</h3>
      <Line label={t("sweep.range")}>
        {end("sweep-from", t("sweep.from"), "from_mm")}
        <span class="quiet">–</span>
        {end("sweep-to", t("sweep.to"), "to_mm")}
        <span class="quiet">mm</span>
      </Line>
      <LabelledChoice
        isInline
        id="sweep-speed"
        label={t("sweep.speed")}
        values={SWEEP_SPEEDS}
        value={choice.mm_per_s}
        words={(speed) => `${number(speed)} mm/s`}
        onChoose={(mm_per_s) => set({ mm_per_s })}
      />
      <Ticked words={t("sweep.turns")} checked={choice.turns} onTick={(turns) => set({ turns })} />
    </>
  );
}
