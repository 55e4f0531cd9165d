// The section of the panel with the layouts that a reader has saved.

import { useRef, useState } from "preact/hooks";

import { number, t } from "../base/i18n.ts";
import { LONGEST_NAME } from "../model/saved-layouts.ts";
import { isNamed } from "../store/holder.ts";
import {
  addLayouts,
  layoutsFile,
  makeSteps,
  recallLayout,
  removeLayout,
  saveLayout,
  savedLayouts,
} from "../store/saved-layouts.ts";
import { Button, FileInput, IconButton, type OfStore, Quiet, Row, Section, Status } from "./fields.tsx";
import { saveFile } from "./picture-file.ts";

export function LayoutsSection({ store }: OfStore) {
  const name = useRef<HTMLInputElement>(null);
  const [said, say] = useState("");
  const layouts = savedLayouts.value;
  const save = (): void => {
    if (!name.current) return;
    say(saveLayout(store, name.current.value));
    if (savedLayouts.peek() !== layouts) name.current.value = "";
  };
  return (
    <Section title="panel.layouts" data-task="read">
      <ol class="saved-layouts">
        {layouts.map((saved, at) => (
          <li key={saved.name}>
            <kbd>{`g ${number(at + 1)}`}</kbd>
            <Button dir="auto" aria-keyshortcuts={`g ${at + 1}`} onClick={() => recallLayout(store, at + 1)}>
              {saved.name}
            </Button>
            <IconButton
              icon="trash"
              label={t("findings.remove", { name: saved.name })}
              onClick={() => removeLayout(at)}
            />
          </li>
        ))}
      </ol>
      <Row>
        <input
          type="text"
          id="layout-name"
          ref={name}
          maxLength={LONGEST_NAME}
          dir="auto"
          autocomplete="off"
          placeholder={t("layouts.name")}
          aria-label={t("layouts.name")}
          onKeyDown={({ key }) => {
            if (key === "Enter") save();
          }}
        />
        <Button onClick={save}>{t("layouts.save")}</Button>
      </Row>
      <Row>
        {layouts.length > 0 && <Button onClick={() => say(makeSteps())}>{t("layouts.make-steps")}</Button>}
        <Button onClick={() => saveFile(layoutsFile(), "isocortex-layouts.json")}>{t("layouts.file")}</Button>
        <FileInput
          id="layouts-file"
          words={t("layouts.add")}
          accept=".json"
          onFiles={([file]) => void file?.text().then((text) => say(addLayouts(text)))}
        />
      </Row>
      <Status words={said} />
      <Quiet>{t(isNamed.value ? "layouts.about-named" : "layouts.about")}</Quiet>
      <p class="quiet keys">{t("layouts.keys")}</p>
    </Section>
  );
}
