-- Tells Isocortex that a series is complete in Orthanc; Isocortex then fetches it by DICOMweb.
-- Orthanc runs this when nothing has come for a series for `StableAge` seconds. A notice that comes twice does no harm.

local server = os.getenv("ISOCORTEX_URL") or "http://isocortex:8640"
-- The token comes from a file.
local token = ""
local file = os.getenv("ISOCORTEX_TOKEN_FILE")
if file then
  token = assert(io.open(file, "r")):read("*l")
end
-- The name of this Orthanc in the configuration of Isocortex (pacs.nodes).
local node = os.getenv("ISOCORTEX_NODE") or "orthanc"

function OnStableSeries(seriesId, tags, metadata)
  if tags["Modality"] ~= "MR" and tags["Modality"] ~= "CT" then
    return
  end
  local study = ParseJson(RestApiGet("/series/" .. seriesId .. "/study"))
  local notice = {
    node = node,
    StudyInstanceUID = study["MainDicomTags"]["StudyInstanceUID"],
    SeriesInstanceUID = tags["SeriesInstanceUID"],
  }
  local headers = { ["content-type"] = "application/json" }
  if token ~= "" then
    headers["authorization"] = "Bearer " .. token
  end
  HttpPost(server .. "/hooks/orthanc", DumpJson(notice, true), headers)
end
