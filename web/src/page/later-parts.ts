// What of the page is fetched when it is first wanted, as one file: see `later.ts`.

export { askToken, confirmDelete, confirmRename, helpDialog, holderDialog, maskDialog } from "./dialogs.ts";
export { captionOf, fileStem } from "./export.ts";
export { exportSection } from "./export-section.ts";
export { FindingsSection } from "./findings-section.ts";
export { profileView } from "./chart.ts";
export { measuredAt } from "./measured.ts";
export { SlicePane } from "../panes/slices.ts";
export { AcrossPane } from "../panes/across.ts";
export { Closer } from "../panes/closer.ts";
export { MapPane } from "../panes/flat-map.ts";
export { ChecklistSection } from "./checklist-section.ts";
export { CaseSection } from "./case-section.ts";
export { Comparison } from "./comparison.ts";
export { CaseLayers } from "./case-layers.ts";
export { LayersSection } from "./layers-section.ts";
export { MeasuresSection } from "./measures-section.ts";
export { LayoutsSection } from "./layouts-section.ts";
export { MapsSection } from "./maps-section.ts";
export { meetNeighbour } from "../pacs/neighbour.ts";
export { Nudge } from "./nudge.ts";
export { OverlayControls } from "./overlay-controls.ts";
export { SweepSection } from "./sweep-section.ts";
export { UploadForm } from "./upload.ts";
