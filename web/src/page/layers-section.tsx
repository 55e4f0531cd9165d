// The section of the panel for the added layers: what they are and how they are placed, which of them are shown, and
// how another one is added.

import { useLayoutEffect, useRef, useState } from "preact/hooks";

import { changeLayer, deleteLayer } from "../base/api.ts";
import { failureWords } from "../base/case-words.ts";
import { type Key, spoken, t } from "../base/i18n.ts";
import { problemWords, sentence } from "../base/problem-words.ts";
import {
  CONTRASTS,
  LAYER_KINDS,
  type Layer,
  type LayerKind,
  TRANSFORMS,
  greyOf,
  isAdded,
  isReady,
} from "../model/layers.ts";
import { isLayerId } from "../model/maps.ts";
import { allLayersOf } from "../model/state.ts";
import { announce } from "../store/announce.ts";
import { askText, confirmDelete } from "./dialogs.tsx";
import {
  Button,
  Choice,
  FileInput,
  IconButton,
  Line,
  type OfStore,
  Quiet,
  Row,
  Section,
  Status,
  Writing,
} from "./fields.tsx";
import { sendLayer, wishOf } from "./layer-form.ts";
import { Comparison, OverlayControls } from "./look-controls.tsx";
import { Nudge } from "./nudge.tsx";
import { Transfer, useTransfer } from "./transfer.tsx";
import { freeName, sortLayers } from "./upload-files.ts";

/** Changes something of the layers, and lists them again. */
type Do = (work: () => Promise<unknown>) => void;

export function LayersSection({ store }: OfStore) {
  const { layers, caseLayers, view } = store;
  const list = caseLayers.list.value;
  const added = list?.layers.filter(isAdded) ?? [];
  const isShown = allLayersOf(view.state.value).some(isLayerId);
  const change: Do = async (work) => {
    layers.said.value = "";
    const focused = document.activeElement;
    try {
      await work();
      await caseLayers.again();
      // The button of a layer that has changed its place has lost the focus on its way.
      if (focused instanceof HTMLElement && document.activeElement === document.body) focused.focus();
    } catch (problem) {
      layers.said.value = problemWords(problem);
    }
  };
  return (
    <Section title="panel.layers" name="added" data-task="images">
      {list ? (
        <>
          {added.length === 0 && <Quiet>{t("layers.none")}</Quiet>}
          <ul class="layers" aria-label={t("panel.layers")}>
            {added.map((layer, at) => (
              <Item key={layer.id} store={store} layer={layer} at={at} count={added.length} change={change} />
            ))}
          </ul>
          {isShown && <Comparison store={store} />}
          <OverlayControls store={store} isOfMap={false} />
          <Nudge store={store} />
          <Writing>
            <AddLayer store={store} />
          </Writing>
          <p class="quiet layers-note" role="status">
            {layers.said.value}
          </p>
        </>
      ) : (
        <Quiet>{t("panel.loading")}</Quiet>
      )}
    </Section>
  );
}

function Item({
  store,
  layer,
  at,
  count,
  change,
}: OfStore & { readonly layer: Layer; readonly at: number; readonly count: number; readonly change: Do }) {
  const { shown, layers, view } = store;
  const { id, name, kind, unit, state, quality, contrast } = layer;
  const isGrey = view.seen.value.layer?.id === id;
  const isColoured = view.seen.value.overlay?.name === id;
  const move = (place: number): void => change(() => changeLayer(shown.id, id, { place }));
  const rename = async (): Promise<void> => {
    const wanted = await askText(t("layer.rename", { name }), t("layer.name"), name);
    if (wanted && wanted !== name) await changeLayer(shown.id, id, { name: wanted });
  };
  const remove = async (): Promise<void> => {
    if (!(await confirmDelete(t("layer.delete-title"), t("layer.delete-text", { name })))) return;
    await deleteLayer(shown.id, id);
    announce(t("layer.deleted", { name }));
    if (isGrey) layers.grey(null);
    if (isColoured) layers.colours(id);
  };
  const acts = [
    ["up", "up", () => move(at - 1), at === 0],
    ["down", "down", () => move(at + 1), at + 1 === count],
    ["rename", "edit", () => change(rename)],
    ["delete", "trash", () => change(remove)],
  ] as const;
  const show = (how: "grey" | "colours", isOn: boolean, onClick: () => void) => (
    <Button value={how} aria-pressed={isOn} aria-label={t(`layer.${how}.of`, { name })} data-do={how} onClick={onClick}>
      {t(`layer.${how}`)}
    </Button>
  );
  return (
    <li data-id={id} data-state={state}>
      <p class="layer-name">
        <strong>{name}</strong>
        <span class="quiet">{[t(`layer.kind.${kind}`), unit].filter(Boolean).join(" · ")}</span>
        {/* The newest FLAIR has a map. */}
        {kind === "mr" && (
          <Writing>
            <Choice
              id={`layer-contrast-${id}`}
              data-do="contrast"
              label={t("layer.contrast.of", { name })}
              values={contrast ? CONTRASTS : (["unknown", ...CONTRASTS] as const)}
              value={contrast ?? "unknown"}
              words={(one) => t(`layer.contrast.${one}`)}
              onChoose={(one) => {
                if (one !== "unknown") change(() => changeLayer(shown.id, id, { contrast: one }));
              }}
            />
          </Writing>
        )}
      </p>
      <p class={`quiet status${quality === "review" ? " doubtful" : ""}`}>{statusWords(layer)}</p>
      <Row>
        {isReady(layer) && greyOf(layer) && show("grey", isGrey, () => layers.grey(isGrey ? null : id))}
        {isReady(layer) && show("colours", isColoured, () => layers.colours(id))}
        <Writing>
          {acts.map(([name, icon, act, isOff = false]) => (
            <IconButton
              key={name}
              icon={icon}
              data-do={name}
              label={t(`layer.${name}`, { name: layer.name })}
              disabled={isOff}
              onClick={act}
            />
          ))}
        </Writing>
      </Row>
    </li>
  );
}

function AddLayer({ store }: OfStore) {
  const { shown, layers, caseLayers } = store;
  const [chosen, setChosen] = useState<readonly File[]>([]);
  const form = useRef<HTMLFormElement>(null);
  const box = useRef<HTMLDetailsElement>(null);
  const latest = useRef(chosen);
  latest.current = chosen;
  const transfer = useTransfer();
  const { volumes: found, labels: named } = sortLayers(chosen);
  const chosenWords = chosen.length === 0 ? "" : t("layer.chosen", { count: found.length });

  const send = async (files: readonly File[], data: FormData): Promise<void> => {
    const { volumes, labels } = sortLayers(files);
    if (volumes.length === 0) return void (layers.said.value = t("upload.nothing"));
    layers.said.value = "";
    const name = String(data.get("name")).trim();
    const kind = LAYER_KINDS.find((one) => one === data.get("kind"));
    const transform = String(data.get("transform"));
    try {
      await transfer.run(async (signal, observe) => {
        for (const volume of volumes) {
          const wish = wishOf(volume, { ...(name && { name }), ...(kind && { kind }), transform });
          const names = caseLayers.list.peek()?.layers.map((one) => one.name) ?? [];
          const named = wish.name && !(name && volumes.length === 1) ? { name: freeName(wish.name, names) } : {};
          const { created, wasThere } = await sendLayer(
            shown.id,
            volume,
            { ...wish, ...named },
            wish.kind === "labels" ? labels : null,
            [signal, observe()],
          );
          layers.said.value = t(wasThere ? "layer.was-there" : "layer.sent", { name: created.name });
          void caseLayers.again().catch(() => {});
        }
      });
      // Others may have been dropped meanwhile.
      if (latest.current !== files) return;
      form.current?.reset();
      setChosen([]);
    } catch (problem) {
      layers.said.value = transfer.isCancelled ? t("upload.cancelled") : problemWords(problem);
    }
  };

  // What was dropped elsewhere is sent at once, unless other files are on their way.
  const dropped = layers.dropped.value;
  useLayoutEffect(() => {
    if (!dropped || !box.current || !form.current) return;
    const { files, isOnForm } = dropped;
    layers.dropped.value = null;
    box.current.open = true;
    box.current.scrollIntoView({ block: "nearest" });
    setChosen(files);
    if (isOnForm) return;
    form.current.reset();
    if (!transfer.isBusy.peek()) void send(files, new FormData(form.current));
  }, [dropped]);

  return (
    <details class="add-layer" ref={box}>
      <summary>{t("layer.add")}</summary>
      <form
        class="layer-form"
        ref={form}
        onSubmit={(event) => {
          event.preventDefault();
          void send(chosen, new FormData(event.currentTarget));
        }}
      >
        <Quiet>{t("layer.hint")}</Quiet>
        <Row>
          <FileInput id="layer-files" words={t("upload.choose-files")} multiple onFiles={setChosen} />
          <FileInput id="layer-folder" words={t("upload.choose-folder")} webkitdirectory onFiles={setChosen} />
        </Row>
        <Status words={named ? `${chosenWords} ${t("layer.chosen-labels")}` : chosenWords} />
        <Line label={t("layer.name")}>
          <input
            type="text"
            id="layer-name"
            name="name"
            maxLength={64}
            autocomplete="off"
            aria-label={t("layer.name")}
          />
        </Line>
        <Line label={t("layer.kind")}>
          <Select name="kind" values={["auto", ...LAYER_KINDS]} />
        </Line>
        <Line label={t("layer.transform")}>
          <Select name="transform" values={TRANSFORMS} />
        </Line>
        <Transfer transfer={transfer} words={t("layer.send")} />
      </form>
    </details>
  );
}

type Chosen = LayerKind | (typeof TRANSFORMS)[number];

const Select = ({ name, values }: { readonly name: "kind" | "transform"; readonly values: readonly Chosen[] }) => (
  <select id={`layer-${name}`} name={name} aria-label={t(`layer.${name}`)}>
    {values.map((one) => (
      <option key={one} value={one}>
        {t(`layer.${name}.${one}` as Key)}
      </option>
    ))}
  </select>
);

/** How far a layer is, and how it is placed. */
function statusWords(layer: Layer): string {
  const { state, origin, verdict, quality, reason, error } = layer;
  if (state === "failed") return failureWords(error);
  if (state !== "ready") return t(state === "queued" ? "layer.queued" : "layer.preparing");
  const placed = t(verdict === "unchanged" ? "origin.unchanged" : `origin.${origin ?? "header"}`);
  if (quality !== "review") return sentence(placed);
  // The reason is in the server's language.
  const why = reason && spoken() === "en" ? ` ${sentence(reason)}` : "";
  return sentence(t("origin.review", { origin: placed })) + why;
}
