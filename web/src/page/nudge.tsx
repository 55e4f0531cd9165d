// Moving a layer by hand: in steps, in the page alone, until it is added as another layer.

import { useLayoutEffect, useRef, useState } from "preact/hooks";

import { getFile } from "../base/api.ts";
import { number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import { positionWords } from "../base/readout.ts";
import { product } from "../model/affine.ts";
import { angleOf, stepOf } from "../model/nudge.ts";
import { subtract, transform } from "../model/space.ts";
import type { Store } from "../store/store.ts";
import { Button, IconButton, type OfStore, Row, Status } from "./fields.tsx";
import { sendLayer } from "./layer-form.ts";
import { freeName } from "./upload-files.ts";

/** The directions of steps: back and forth along the axes, or about them. */
const LETTERS = ["R", "L", "A", "P", "I", "S"] as const;
const TURNS = ["up", "down", "undo", "redo", "left", "right"] as const;
/** The place of a key's direction among the letters, and with shift among the turns. */
const KEYS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [0, 4],
  ArrowRight: [1, 5],
  ArrowUp: [2, 0],
  ArrowDown: [3, 1],
  PageDown: [4, 2],
  PageUp: [5, 3],
};

export function Nudge({ store }: OfStore) {
  const { layers, shown, view } = store;
  const summary = useRef<HTMLElement>(null);
  const [said, say] = useState("");
  const nudges = layers.nudges.value;
  const moved = layers.moved.value;
  const center = shown.envelope_sphere.center_in_patient;
  // A key opens the part, so that further keys move the layer.
  useLayoutEffect(() => {
    if (nudges === 0) return;
    summary.current?.closest("details")?.setAttribute("open", "");
    summary.current?.focus();
  }, [nudges]);
  const step = (direction: number, turns: boolean): void => {
    const made = stepOf(direction, turns, center);
    const { value: before } = layers.moved;
    say("");
    layers.moved.value = before ? product(made, before) : made;
  };
  const key = (event: KeyboardEvent): void => {
    const found = KEYS[event.key];
    if (!found || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const isFlipped = view.now.convention === "neurological";
    const direction = found[event.shiftKey ? 1 : 0];
    // Left and right are those of the slices.
    step(isFlipped && found[0] < 2 ? direction ^ 1 : direction, event.shiftKey);
  };
  const shift = moved && positionWords(subtract(transform(moved, center), center));
  const words = shift && t("nudge.moved", { shift, angle: number(angleOf(moved), 1) });
  return (
    <details class="nudge" hidden={layers.shownId.value === null} onKeyDown={key}>
      <summary ref={summary}>{t("nudge.label")}</summary>
      <Row>
        {LETTERS.map((letter, at) => (
          <Button key={letter} aria-label={t(`shift.${letter}`)} onClick={() => step(at, false)}>
            {letter}
          </Button>
        ))}
      </Row>
      <Row>
        {TURNS.map((turn, at) => (
          <IconButton key={turn} icon={turn} label={t(`tilt.${turn}`)} onClick={() => step(at, true)} />
        ))}
      </Row>
      {moved && (
        <Row>
          <Button onClick={() => void add(store, say)}>{t("nudge.add")}</Button>
          <Button
            onClick={() => {
              say("");
              layers.moved.value = null;
            }}
          >
            {t("nudge.drop")}
          </Button>
        </Row>
      )}
      <Status words={said || words || ""} />
    </details>
  );
}

/** Sends the voxels back with the matrix, and shows the new layer once it is ready. */
async function add({ layers, caseLayers, shown, view }: Store, say: (words: string) => void): Promise<void> {
  const shownId = layers.shownId.peek();
  const layer = shownId === null ? null : caseLayers.ready(shownId);
  const transformed = layers.moved.peek();
  if (!layer || !transformed) return;
  const { id, name, kind, unit, labels } = layer;
  say(t("export.working"));
  try {
    const file = new File([await getFile(`${shown.id}/layers/${id}/nifti`)], "layer.nii.gz");
    const wish = { name: freeName(name.slice(0, 60), caseLayers.names), kind, unit, transform: transformed };
    const names = labels?.map((one) => `${one.value} ${one.name}\n`) ?? [];
    const quietly = [new AbortController().signal, () => {}] as const;
    const { created } = await sendLayer(shown.id, [file], wish, names.length > 0 ? new Blob(names) : null, quietly);
    await caseLayers.again();
    if (layers.shownId.peek() === id) {
      const { layer, overlay } = view.seen.peek();
      if (layer?.id === id) layers.grey(created.id);
      else if (overlay?.name === id) layers.colours(created.id);
    }
    say(t("layer.sent", { name: created.name }));
  } catch (problem) {
    say(problemWords(problem));
  }
}
