-- Requests for wrk: `wrk ... -s load.lua URL -- KIND CASE`. Depths and angles vary, so that no cache of whole answers helps.
local variants = 389
local kind, case, count

function init(arguments)
  kind, case = arguments[1], arguments[2]
  count = 0
end

function request()
  count = count + 1
  local share = (count % variants) / variants
  local paths = {
    list = "/v1/cases",
    mesh = string.format("/v1/cases/%s/mesh?depth_mm=%.3f", case, 30 * share),
    paths = string.format("/v1/cases/%s/mesh/paths", case),
    render = string.format("/v1/cases/%s/render?renderer=splat&depth_mm=%.3f&orientation=0,0,%.5f,%.5f",
      case, 30 * share, math.sin(math.pi * share), math.cos(math.pi * share)),
  }
  return wrk.format("GET", paths[kind])
end

function done(summary, latency, _)
  local seconds = summary.duration / 1e6
  local errors = summary.errors
  print(string.format("%.1f,%.3f,%.3f,%.1f,%d", summary.requests / seconds, latency:percentile(50) / 1e3,
    latency:percentile(99) / 1e3, summary.bytes / 1024 / math.max(summary.requests, 1),
    errors.connect + errors.read + errors.write + errors.status + errors.timeout))
end
