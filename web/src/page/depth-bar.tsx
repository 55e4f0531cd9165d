// The bar below the picture: the depth, its steps and the sweep.

import { useState } from "preact/hooks";

import { number, numberUpTo, readNumber, t } from "../base/i18n.ts";
import { depthOfShare, shareOfDepth, ticksTo } from "../model/depth-scale.ts";
import { DEPTH_STEP_MM, FINE_DEPTH_STEP_MM, GOOD_DEPTHS_MM, clampDepth, stepDepth } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import { choose, preferences } from "../store/preferences.ts";
import { Bar, IconButton, Menu, type OfStore, Quiet, Remark, Typed } from "./fields.tsx";

/** The slider's own numbers: its places, not millimetres, for its two halves are of different scales. */
const PLACES = 1000;
/** What is written also beside a short slider. */
const MAJOR_TICKS_MM: readonly number[] = [0, ...GOOD_DEPTHS_MM, 40];
/** What the keys of a slider do, in steps of the depth. */
const KEYS: Readonly<Record<string, number>> = {
  ArrowRight: 1,
  ArrowUp: 1,
  ArrowLeft: -1,
  ArrowDown: -1,
  PageUp: -10,
  PageDown: 10,
};

export function DepthBar({ store }: OfStore) {
  const { view, shown } = store;
  const depth_mm = view.depth_mm.value;
  const isRunning = store.sweep.isRunning.value;
  const deepest = clampDepth(Infinity, shown);
  const take = (wanted_mm: number): void => {
    if (Number.isFinite(wanted_mm)) store.change({ depth_mm: clampDepth(wanted_mm, shown) });
  };
  const step = (steps: number): void => perform(store, { kind: "depth", steps, fine: false });
  const keyed = (event: KeyboardEvent): void => {
    const steps = KEYS[event.key];
    const ends = { Home: 0, End: deepest }[event.key];
    if ((steps === undefined && ends === undefined) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    event.stopPropagation();
    take(ends ?? stepDepth(view.now.depth_mm, steps ?? 0, DEPTH_STEP_MM));
  };
  return (
    <div class="depth-bar" role="group" aria-label={t("depth.label")}>
      <IconButton
        icon={isRunning ? "pause" : "play"}
        label={t(isRunning ? "depth.pause" : "depth.play")}
        class="icon-button play"
        onClick={() => perform(store, { kind: "play" })}
      />
      <IconButton icon="minus" label={t("depth.less")} onClick={() => step(-1)} />
      <div class="depth-track">
        <GoodDepths deepest={deepest} />
        <input
          type="range"
          id="depth"
          min={0}
          max={PLACES}
          step={1}
          aria-label={t("depth.label")}
          aria-valuetext={`${number(depth_mm, 1)} mm`}
          value={Math.round(PLACES * shareOfDepth(depth_mm, deepest))}
          onInput={({ currentTarget }) => {
            const depth = depthOfShare(currentTarget.valueAsNumber / PLACES, deepest);
            take(Math.round(depth / DEPTH_STEP_MM) * DEPTH_STEP_MM);
          }}
          onKeyDown={keyed}
        />
        <div class="depth-ticks" aria-hidden="true">
          {ticksTo(deepest).map((depth) => (
            <span
              key={depth}
              class={MAJOR_TICKS_MM.includes(depth) ? undefined : "minor"}
              style={{ "--at": String(shareOfDepth(depth, deepest)) }}
            >
              {number(depth)}
            </span>
          ))}
        </div>
      </div>
      <IconButton icon="plus" label={t("depth.more")} onClick={() => step(1)} />
      <DepthNumber store={store} take={take} />
      <span class="unit">mm</span>
      <Slant store={store} />
    </div>
  );
}

/** The share of the boundary that the cut meets slantwise at the depth that is shown; in its menu, at all depths at which there is any. */
function Slant({ store }: OfStore) {
  const { junction_by_depth = [], junction_poorly_met } = store.caseLayers.list.value ?? {};
  const depth_mm = store.view.depth_mm.value;
  const bands = junction_by_depth
    .filter(({ places }) => places > 0)
    .map(({ from_mm, to_mm, slanted_share }) => ({
      label: to_mm === undefined ? `> ${number(from_mm)} mm` : `${number(from_mm)} – ${number(to_mm)} mm`,
      share: slanted_share,
      words: `${number(100 * slanted_share)} %`,
      isShown: from_mm <= depth_mm && depth_mm < (to_mm ?? Infinity),
    }));
  if (bands.length === 0) return null;
  const here = bands.find(({ isShown }) => isShown)?.words ?? "–";
  return (
    <Menu name="slant" class="slant" title={t("map.slant")} button={t("map.slant-here", { share: here })}>
      <Quiet>{t("map.slant")}</Quiet>
      {bands.map(({ isShown, ...band }) => (
        <Bar key={band.label} aria-current={isShown} {...band} />
      ))}
      <p class="poorly-met">
        {junction_poorly_met !== undefined && t("map.slant.total", { share: number(100 * junction_poorly_met) })}
      </p>
    </Menu>
  );
}

/** The depth in its box, which is not corrected while it is being typed. A box for numbers would write them in the browser's language. */
function DepthNumber({ store, take }: OfStore & { take(depth_mm: number): void }) {
  const { view } = store;
  const written = (): string => numberUpTo(view.depth_mm.value, 2);
  // What was typed may be out of range, or no number; an empty box has no change to tell of.
  const leave = (box: HTMLInputElement): void => {
    box.value = written();
  };
  return (
    <Typed
      inputMode="decimal"
      id="depth-number"
      aria-label={t("depth.number")}
      value={written()}
      onLeave={(typed) => {
        take(readNumber(typed));
        return written();
      }}
      onKeyDown={(event) => {
        if (event.key === "Escape") leave(event.currentTarget);
        if (event.key === "Enter") event.currentTarget.blur();
        const steps = { ArrowUp: 1, ArrowDown: -1 }[event.key];
        if (steps === undefined) return;
        event.preventDefault();
        take(stepDepth(view.now.depth_mm, steps, FINE_DEPTH_STEP_MM));
        leave(event.currentTarget);
      }}
      onBlur={({ currentTarget }) => leave(currentTarget)}
    />
  );
}

/** The depths at which most sulci are cut across. */
function GoodDepths({ deepest }: { readonly deepest: number }) {
  const [from, to] = GOOD_DEPTHS_MM.map((depth) => shareOfDepth(Math.min(depth, deepest), deepest));
  return <span class="good-depths" title={t("depth.good")} style={{ "--from": String(from), "--to": String(to) }} />;
}

/**
 * A line for those who see the depth slider for the first time, until they dismiss it. Whoever has changed the depth does not see it
 * with the next case: to take it away at once would move all pictures.
 */
export function Explanation() {
  const [isKnown, setKnown] = useState(preferences.peek().knows_depth);
  if (isKnown) return null;
  const dismiss = (): void => {
    setKnown(true);
    choose({ knows_depth: true });
  };
  return (
    <Remark name="first-time" role="note" dismiss={dismiss}>
      <span>{t("depth.first-time")}</span>
    </Remark>
  );
}
