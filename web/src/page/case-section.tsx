// What is known of the case and its mask, and what can be made of it: the mask's outline, its files, versions.

import { dateWords } from "../base/pacs.ts";
import { useRef, useState } from "preact/hooks";

import { changeCase, getCase, getDicom, getFile, handOver, makeVersion } from "../base/api.ts";
import { caseTitle, reasonWords, voxelWords } from "../base/case-words.ts";
import { known, moment, number, t } from "../base/i18n.ts";
import { problemWords } from "../base/problem-words.ts";
import type { Case, ReadyCase } from "../model/case.ts";
import { type MaskBlock, decodeMask } from "../model/mask.ts";
import { doubtsOf } from "../model/quality.ts";
import { askText } from "./dialogs.tsx";
import { fileStem } from "./export.ts";
import { Button, FileInput, type OfStore, Row, Section, Status, Ticked, Writing } from "./fields.tsx";
import { saveFile } from "./picture-file.ts";
import { maskDialog } from "./server-picture.tsx";

/** Hears that a version was made, or was there. */
export type Made = (one: Case, wasThere: boolean) => void;

/** Attributes of DICOM files that say which series it is, and when it was acquired. */
const SERIES = ["SeriesDescription", "ProtocolName", "AcquisitionDate"] as const;
type Fact = readonly [string, string];

export function CaseSection({ store, made }: OfStore & { readonly made: Made }) {
  const { shown } = store;
  const [note, say] = useState("");
  /** As far as it is known whether it is kept. */
  const [age, setAge] = useState<Case>(shown);
  /** What is known of its series. */
  const [series, setSeries] = useState<readonly Fact[]>([]);
  const mask = useRef<MaskBlock | null>(null);
  const asked = useRef<Promise<Case> | null>(null);

  /** Does what may go wrong, and says so. */
  const attempt = async (work: () => Promise<string | void>): Promise<void> => {
    try {
      say((await work()) ?? "");
    } catch (problem) {
      say(problemWords(problem));
    }
  };
  /** Whether it is kept, and until when it stays if it is not; of several answers the last one counts. */
  const tellAge = (answer: Promise<Case>): Promise<void> =>
    attempt(async () => {
      asked.current = answer;
      const now = await answer;
      if (asked.current === answer) setAge(now);
    });
  // The label stands in many places: the page is loaded again.
  const rename = (): Promise<void> =>
    attempt(async () => {
      const name = await askText(t("case.rename"), t("case.label"), shown.name ?? "");
      if (!name) return;
      await changeCase(shown.id, { name });
      handOver();
      location.reload();
    });
  // The series is patient data: it is asked for by a hand alone.
  const tellSeries = (): Promise<void> =>
    attempt(async () => {
      const found = await getDicom(shown.id);
      setSeries(
        SERIES.filter((key) => found[key]).map((key) => [
          t(`case.${key}`),
          key === "AcquisitionDate" ? dateWords(found[key]) : (found[key] ?? ""),
        ]),
      );
    });
  const outline = (isShown: boolean): Promise<void> =>
    attempt(async () => {
      if (isShown) mask.current ??= await fetchMask(shown.id);
      store.mask.value = isShown ? mask.current : null;
    });
  const save = (what: "mask" | "envelope"): Promise<void> =>
    attempt(async () => {
      saveFile(await getFile(`${shown.id}/${what}`), `${fileStem(shown)}-${what}.nii.gz`);
      return t("export.file-saved");
    });

  return (
    <Section
      title="panel.case"
      data-task="case"
      // The list may know an earlier state of it.
      onOpen={() => {
        if (!asked.current) void tellAge(getCase(shown.id));
      }}
    >
      <dl class="point case-facts">
        {[...factsOf(shown, age, series)].map(([name, value]) => (
          <>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </>
        ))}
      </dl>
      {shown.links?.dicom && (
        <Row>
          <Button onClick={() => void tellSeries()}>{t("case.ask-series")}</Button>
        </Row>
      )}
      <Writing>
        <Ticked
          id="keep-case"
          words={t("case.keep")}
          checked={age.kept}
          onTick={(kept) => void tellAge(changeCase(shown.id, { kept }))}
        />
      </Writing>
      <Ticked
        id="mask-outline"
        words={t("case.outline")}
        checked={store.mask.value !== null}
        onTick={(isShown) => void outline(isShown)}
      />
      <Row>
        <Writing>
          <Button onClick={() => void rename()}>{t("case.rename")}</Button>
        </Writing>
        <Button onClick={() => maskDialog(shown.id)}>{t("quality.look")}</Button>
        <Button onClick={() => void save("mask")}>{t("case.save-mask")}</Button>
        <Button onClick={() => void save("envelope")}>{t("case.save-envelope")}</Button>
      </Row>
      <Writing>
        <Version shown={shown} made={made} say={say} attempt={attempt} />
      </Writing>
      <Status words={note} />
    </Section>
  );
}

/** The form for a version of the case with another mask, or other parameters. */
function Version({
  shown,
  made,
  say,
  attempt,
}: {
  readonly shown: ReadyCase;
  readonly made: Made;
  say(words: string): void;
  attempt(work: () => Promise<string>): Promise<void>;
}) {
  const [mask, setMask] = useState<File | null>(null);
  const [isBusy, setBusy] = useState(false);
  const offset = useRef<HTMLInputElement>(null);
  const radius = useRef<HTMLInputElement>(null);
  const make = async (event: SubmitEvent): Promise<void> => {
    event.preventDefault();
    const [offset_mm, radius_mm] = [offset, radius].map(({ current }) => current?.valueAsNumber ?? NaN) as [
      number,
      number,
    ];
    // A mask that is handed in is taken as it is, unless another offset is asked for.
    const hasOffset = Number.isFinite(offset_mm) && (mask === null || offset_mm !== shown.offset_mm);
    const parameters = {
      ...(Number.isFinite(radius_mm) && { closing_radius_mm: String(radius_mm) }),
      ...(hasOffset && { offset_mm: String(offset_mm) }),
    };
    setBusy(true);
    say(t("version.sending"));
    await attempt(async () => {
      const { created, wasThere } = await makeVersion(shown.id, parameters, mask);
      if (created.id === shown.id) return t("version.itself");
      made(created, wasThere);
      return t(wasThere ? "version.was-there" : "version.made");
    });
    setBusy(false);
  };
  return (
    <form class="version" onSubmit={(event) => void make(event)}>
      <h3>{t("version.title")}</h3>
      <label class="inline">
        {t("version.offset")}
        <input
          type="number"
          id="version-offset"
          ref={offset}
          min={-20}
          max={20}
          step={0.5}
          defaultValue={String(shown.offset_mm)}
        />
      </label>
      <label class="inline">
        {t("version.radius")}
        <input type="number" ref={radius} min={0} max={50} step={0.5} defaultValue={String(shown.closing_radius_mm)} />
      </label>
      <FileInput
        label={t("version.mask")}
        words={t("upload.choose-files")}
        hint={mask?.name ?? t("version.mask-hint")}
        accept=".nii,.gz,.mgh,.mgz"
        onFiles={([file = null]) => setMask(file)}
      />
      <Row>
        <button type="submit" disabled={isBusy}>
          {t("version.make")}
        </button>
      </Row>
    </form>
  );
}

async function fetchMask(id: string): Promise<MaskBlock> {
  const packed = await getFile(`${id}/mask`);
  const unpacked = packed.stream().pipeThrough(new DecompressionStream("gzip"));
  return decodeMask(await new Response(unpacked).arrayBuffer());
}

function factsOf(shown: ReadyCase, age: Case, series: readonly Fact[]): readonly Fact[] {
  const { volume, envelope_ml, max_depth_mm, mask_kind, quality } = shown;
  const found = doubtsOf(quality);
  const doubts = found.length > 0 ? found : [quality?.state ?? ("unknown" as const)];
  const method = known(`method.${quality?.method ?? ""}`);
  const brain_ml = quality?.numbers?.brain_ml;
  const missing = volume.interpolated_slices?.length ?? 0;
  const mask = [method && t(method), brain_ml !== undefined && `${number(brain_ml)} ml`].filter(Boolean).join(", ");
  const [width, length, height] = quality?.numbers?.extents_mm ?? [];
  const verdict = [...doubts.map((doubt) => t(`quality.${doubt}`)), ...(quality ? reasonWords(quality) : [])];
  const radius = mask_kind === "envelope" ? t("case.not-closed") : `${number(shown.closing_radius_mm, 1)} mm`;
  return [
    [t("case.label"), caseTitle(shown)],
    [t("case.uploaded"), moment(shown.created_at)],
    ...(age.expires_at ? [[t("case.expires"), moment(age.expires_at)] as const] : []),
    ...(volume.sequence ? [[t("case.sequence"), volume.sequence] as const] : []),
    ...series,
    [t("case.volume"), `${volume.size.map((side) => number(side)).join(" × ")}, ${voxelWords(shown)}`],
    ...(missing > 0 ? [[t("case.interpolated"), number(missing)] as const] : []),
    [t("case.mask"), mask || "–"],
    ...(width && length && height
      ? [[t("case.extents"), `${[length, width, height].map((mm) => number(mm)).join(" × ")} mm`] as const]
      : []),
    [t("case.verdict"), verdict.join("\n")],
    [t("case.radius"), radius],
    ...(shown.offset_mm === 0 ? [] : [[t("case.offset"), `${number(shown.offset_mm, 1)} mm`] as const]),
    [t("case.envelope"), `${number(envelope_ml)} ml, ${t("case.deep", { depth: number(max_depth_mm, 1) })}`],
  ];
}
