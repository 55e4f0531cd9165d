// The section of the panel for the maps: which of them lies over the picture, how, and lists of places to look at.

import { reasonIn } from "../base/case-words.ts";
import { number, t } from "../base/i18n.ts";
import { keyOf } from "../model/keys.ts";
import { LISTING_MAPS, MAP_NAMES, type MapName, isLayerId, isMap } from "../model/maps.ts";
import { layersOf } from "../model/state.ts";
import { perform } from "../store/commands.ts";
import { LIST_WORDS, type PlacesOfMap } from "../store/places.ts";
import { Comparison } from "./comparison.tsx";
import { Button, Buttons, Choice, Line, type OfStore, Quiet, Row, Section, Status } from "./fields.tsx";
import { OverlayControls } from "./overlay-controls.tsx";
import { PlacesTable } from "./places-table.tsx";

/** Those that list no places. */
const OTHER_MAPS: readonly MapName[] = MAP_NAMES.filter((name) => !LISTING_MAPS.some((listing) => listing === name));

export function MapsSection({ store }: OfStore) {
  const { caseLayers, places, view } = store;
  const layers = caseLayers.list.value?.layers;
  const { overlay } = view.state.value;
  const map = overlay && isMap(overlay.name) ? overlay.name : null;
  const isLayerShown = layersOf(view.state.value).some(isLayerId);
  const flair = layers?.find(({ id }) => id === "flair");
  const choose = (name: MapName | "none"): void => {
    if (name === "none") store.change({ overlay: null }, true);
    else if (map !== name) perform(store, { kind: "map", name });
  };
  return (
    <Section title="panel.maps" name="maps" data-task="read">
      <Buttons
        label={t("map.label")}
        values={["none", ...LISTING_MAPS]}
        value={overlay ? map : "none"}
        words={(name) => t(`map.${name}`)}
        // It is offered only if there is such a layer.
        about={(name) => ({
          hidden: name === "flair" && !flair,
          title: keyOf((command) => command.kind === "map" && command.name === name),
        })}
        onChoose={choose}
      />
      <Choice
        id="more-maps"
        label={t("map.more")}
        values={["none", ...OTHER_MAPS]}
        value={map && OTHER_MAPS.includes(map) ? map : "none"}
        words={(name) => t(name === "none" ? "map.more" : `map.${name}`)}
        onChoose={choose}
      />
      {map && <Quiet>{t(`map.${map}.about`)}</Quiet>}
      {!isLayerShown && <Comparison store={store} />}
      <OverlayControls store={store} isOfMap />
      <Status class="quiet maps-status" id="maps-status" words={places.said.value} />
      {places.lists.map((list) => (
        <PlacesPart key={list.map} store={store} list={list} />
      ))}
      <Slant store={store} />
    </Section>
  );
}

/** The places of one map: a button that asks for them, what there is to say about them, and their table. */
function PlacesPart({ store, list }: OfStore & { readonly list: PlacesOfMap }) {
  const layers = store.caseLayers.list.value?.layers;
  const isFlair = list.map === "flair";
  const map = isFlair ? layers?.find(({ id }) => id === "flair") : layers?.[0];
  if (isFlair && !map) return null;
  const isKnown = map?.state !== "undefined" && map?.state !== "off";
  const words = LIST_WORDS[list.map];
  // A list that nobody asked for takes no place.
  const found = list.list.value;
  const { state, reasons, reason_codes } = found?.regions ?? { state: "ok", reasons: [], reason_codes: [] };
  const why =
    isFlair && map?.state === "undefined"
      ? t("flair.undefined", { reason: reasonIn(map.reason ?? "", map.reason_code) })
      : "";
  return (
    <div class="group-part">
      <Row>
        <Button
          aria-describedby="maps-status"
          disabled={list.isAsking.value || !isKnown}
          onClick={() => void store.places.ask(list)}
        >
          {t(words.ask)}
        </Button>
      </Row>
      <Status words={why} />
      {found && (
        <>
          <Status class="nothing" words={list.nothingWords} />
          {state === "review" && (
            <p class="quiet regions-doubt">
              {t("regions.doubt", { reason: reasonIn(reasons[0] ?? "", reason_codes[0] ?? "") })}
            </p>
          )}
          {list.candidates.length > 0 && (
            <>
              <details class="candidates-warning">
                <summary>{t("candidates.normal")}</summary>
                <Quiet>{`${t(words.warning)} ${t("candidates.score-about")}`}</Quiet>
              </details>
              <PlacesTable store={store} list={list} label={t(words.ask)} />
            </>
          )}
        </>
      )}
    </div>
  );
}

/** The share of the junction that the cuts meet slantwise: at the depth that is shown, and unfolded, at all at which there is any. */
function Slant({ store }: OfStore) {
  const { junction_by_depth = [], junction_poorly_met } = store.caseLayers.list.value ?? {};
  const depth_mm = store.view.depth_mm.value;
  const bands = junction_by_depth
    .filter(({ places }) => places > 0)
    .map(({ from_mm, to_mm, slanted_share }) => ({
      depths: to_mm === undefined ? `> ${number(from_mm)} mm` : `${number(from_mm)} – ${number(to_mm)} mm`,
      share: `${number(100 * slanted_share)} %`,
      slanted_share,
      isShown: from_mm <= depth_mm && depth_mm < (to_mm ?? Infinity),
    }));
  if (bands.length === 0) return null;
  const { share = "–" } = bands.find(({ isShown }) => isShown) ?? {};
  return (
    <details class="slant">
      <summary>{t("map.slant-here", { share })}</summary>
      <Quiet>{t("map.slant")}</Quiet>
      {bands.map(({ depths, share, slanted_share, isShown }) => (
        <Line key={depths} label={depths} aria-current={isShown}>
          <meter value={slanted_share} aria-label={`${depths}: ${share}`} />
          <span class="value quiet" aria-hidden="true">
            {share}
          </span>
        </Line>
      ))}
      <p class="poorly-met">
        {junction_poorly_met !== undefined && t("map.slant.total", { share: number(100 * junction_poorly_met) })}
      </p>
    </details>
  );
}
