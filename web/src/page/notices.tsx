// The lines above the picture: what went wrong, who draws, and how far the loading is.

import type { ComponentChildren } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";

import { reasonWords } from "../base/case-words.ts";
import { number, t } from "../base/i18n.ts";
import type { Quality } from "../model/case.ts";
import { doubtsOf } from "../model/quality.ts";
import { noted } from "../store/announce.ts";
import { type OfStore, Remark } from "./fields.tsx";

/** So many parts of an address are named, and so much of each. */
const MOST_UNREAD = 5;
const LONGEST_UNREAD = 40;

/** Names the parts of an address that could not be used; empty: all could. */
export function unreadWords(parts: readonly string[]): string {
  const named = parts.slice(0, MOST_UNREAD).map((part) => `“${part.slice(0, LONGEST_UNREAD)}”`);
  return named.length > 0 ? t("address.unread", { parts: named.join(", ") }) : "";
}

export function Notices({ store, isShared }: OfStore & { readonly isShared: boolean }) {
  const trouble = store.trouble.value;
  const fallback = store.status.value?.fallback;
  const remark = store.remark.value;
  const patient = store.patient.value;
  return (
    <>
      {patient && (
        <p class="patient-banner" aria-label={t("pacs.patient")}>
          {patient}
        </p>
      )}
      <div class="notices">
        <p class="notice-line bad" role="alert" hidden={trouble === ""}>
          {trouble}
        </p>
        <p class="notice-line" role="status" hidden={!fallback}>
          {fallback && t(isShared ? "share.no-webgl" : `fallback.${fallback}`)}
        </p>
        <Remark hidden={remark === ""} dismiss={() => (store.remark.value = "")}>
          <span>{remark}</span>
        </Remark>
      </div>
    </>
  );
}

/** A warning before a picture whose sides or mask are doubtful, with a control that says more. */
export function Verdict({
  quality,
  children,
}: {
  readonly quality: Quality | undefined;
  readonly children?: ComponentChildren;
}) {
  const doubts = doubtsOf(quality);
  // Beside another case that has one, it keeps its room.
  if (!quality || doubts.length === 0) return <div class="quality" hidden />;
  return (
    <div class="quality" role="note" data-verdict={quality.state}>
      {doubts.map((doubt) => [
        <strong class="quality-badge" data-verdict={quality.state}>
          {t(`quality.${doubt}`)}
        </strong>,
        <span>{t(`quality.${doubt}.text`)}</span>,
      ])}
      {children}
      <ul>
        {reasonWords(quality).map((reason) => (
          <li>{reason}</li>
        ))}
      </ul>
    </div>
  );
}

/** How far the loading is: over the picture, which it does not move. */
export function LoadingLine({ store, cancel, again }: OfStore & { cancel(): void; again(): void }) {
  const loading = store.loading.value;
  const button = useRef<HTMLButtonElement>(null);
  const isCancelled = loading === "cancelled";
  // The focus was on the button that is gone.
  useLayoutEffect(() => {
    if (isCancelled && document.activeElement === document.body) button.current?.focus();
  }, [isCancelled]);
  if (loading === null || loading === "begun") return <div class="loading-line" hidden />;
  if (loading === "cancelled")
    return (
      <div class="loading-line">
        <span>{t("load.cancelled")}</span>
        <button type="button" class="load-again" ref={button} onClick={again}>
          {t("load.again")}
        </button>
      </div>
    );
  const { stage, loaded, total } = loading;
  // A full bar that waits would say that it is over.
  const isWaiting = stage === "ready" || total === 0;
  const megabytes = (bytes: number): string => number(bytes / 1e6, 1);
  const bytes = isWaiting ? "" : t("load.bytes", { loaded: megabytes(loaded), total: megabytes(total) });
  return (
    <div class="loading-line">
      <span>{t(`load.${stage}`) + bytes}</span>
      <progress max={1} aria-label={t("load.label")} {...(!isWaiting && { value: Math.min(loaded / total, 0.99) })} />
      <button type="button" class="cancel-load" onClick={cancel}>
        {t("load.cancel")}
      </button>
    </div>
  );
}

/** What a key that found nothing to do has to say: it stands on the pictures for a moment, and is read out by itself. */
export function Note() {
  const { words, count } = noted.value;
  return (
    <p key={count} class="note" aria-hidden="true" hidden={words === ""}>
      {words}
    </p>
  );
}
