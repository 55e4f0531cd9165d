"""A prepared head, and the surfaces below which depths are measured."""

from __future__ import annotations

import gzip
import io
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Sequence
from urllib.parse import quote

import numpy as np

from ._extras import nibabel, pandas, pillow
from ._freesurfer import write_subject
from ._http import FLIP, Bar, Connection, IsocortexError, flipped, warn
from ._upload import opened, upload

if TYPE_CHECKING:
    from typing import Literal

    import httpx
    from nibabel.gifti.gifti import GiftiImage
    from nibabel.nifti1 import Nifti1Image
    from numpy.typing import NDArray
    from pandas import DataFrame
    from PIL.Image import Image as Picture

    from ._upload import Image

    SurfaceName = Literal["whole", "left", "right", "cerebrum"]
    View = Literal["left", "right", "anterior", "posterior", "superior", "inferior", "mesial-left", "mesial-right"]
    Plane = Literal["axial", "coronal", "sagittal"]
    ListedMap = Literal["blur", "thickness", "flair"]
    Region = Literal["cerebrum", "all"]
    Language = Literal["en", "pt-BR"]
    Paths = Literal["forest", "flow"]
    ValueName = Literal["intensity", "depth", "blur", "thickness", "flair"]

POLL_EVERY_S = 0.3
XYZ = ("x_mm", "y_mm", "z_mm")
# What voxels have values of, besides maps and added layers.
VOXELS = ("brain", "depth", "sides", "regions", "blur-places", "thickness-places", "flair-places")


class Mesh(NamedTuple):
    """A mesh, as nilearn and FreeSurfer's tools expect it: `coordinates, faces = case.mesh(8.0)`."""

    coordinates: NDArray[np.float32]
    """Scanner RAS in mm, (vertices, 3)."""
    faces: NDArray[np.int32]
    """Numbers of vertices, (triangles, 3), counter-clockwise seen from outside."""

    def finite(self) -> Mesh:
        """The mesh without vertices of unknown depth, which nilearn and other programs do not accept."""
        known = ~np.isnan(self.coordinates[:, 0])
        whole = self.faces[np.all(known[self.faces], axis=1)]
        numbers = np.cumsum(known, dtype=np.int32) - 1
        return Mesh(self.coordinates[known], numbers[whole])

    def __repr__(self) -> str:
        return f"<Mesh of {len(self.coordinates)} vertices and {len(self.faces)} triangles, RAS mm>"


class Surface:
    """A surface of a head, and the cuts below it.

    :class:`Case` is the surface of the whole brain, :meth:`Case.surface` returns others.
    """

    def __init__(self, connection: Connection, id: str, surface: SurfaceName, facts: dict[str, Any]) -> None:
        self.id = id
        """32 hexadecimal digits, a digest of the volume, the mask and the parameters."""
        self._connection = connection
        self._path = f"/v1/cases/{id}"
        self._surface = surface
        self._facts = facts

    @property
    def max_depth_mm(self) -> float:
        """The depth of the deepest voxel."""
        return float(self._facts["max_depth_mm"])

    @property
    def envelope_ml(self) -> float:
        """The volume of the envelope."""
        return float(self._facts["envelope_ml"])

    def __repr__(self) -> str:
        return f"<Surface {self._surface} of case {self.id[:8]}, 0 to {self.max_depth_mm:.1f} mm deep>"

    def mesh(self, depth_mm: float = 0.0, *, contours: int = 100, points: int = 100, paths: Paths = "forest") -> Mesh:
        """The surface at a depth, as a mesh with a vertex for each point of the envelope.

        It has `contours * points + 2` vertices and the same triangles at every depth, so that vertex `n` of one depth
        belongs to vertex `n` of another. A vertex is NaN if its depth is unknown: a face of the volume that cuts the
        brain, or the border of a part of the brain, is nearer than the dura; :meth:`Mesh.finite` leaves these out.
        Deep meshes fold; :meth:`isosurface` does not.

        paths: along which vertices move: `"forest"`, as in the paper, or `"flow"`, the gradient of the depth, which
            keeps them near to where they began.

        >>> coordinates, faces = case.mesh(8.0)
        >>> coordinates.shape, faces.shape
        ((10002, 3), (20000, 3))
        """
        size = {"contours": contours, "points": points}
        query = {"depth_mm": depth_mm, "surface": self._surface, "paths": paths, **size}
        answer = self._connection.get(f"{self._path}/mesh", query, "application/octet-stream")
        self._warn_if_too_deep(depth_mm)
        triangles = self._connection.get(f"{self._path}/mesh/triangles", size)
        faces = np.frombuffer(triangles.content, "<u4").reshape(-1, 3)
        return Mesh(_positions(answer.content), faces.astype(np.int32))

    def values(
        self,
        depth_mm: float = 0.0,
        name: ValueName = "intensity",
        *,
        contours: int = 100,
        points: int = 100,
        paths: Paths = "forest",
    ) -> NDArray[np.float32]:
        """A value of each vertex of :meth:`mesh`, whose other arguments must be the same.

        name: `"intensity"` of the volume; `"depth"`, which is less than that of the mesh if a path ends before it; or
            a map, `"blur"`, `"thickness"`, or `"flair"` if a FLAIR was added.

        A value is NaN if it is undefined there, or the depth is unknown.

        >>> coordinates, faces = case.mesh(8.0)
        >>> blur = case.values(8.0, "blur")
        >>> len(blur) == len(coordinates)
        True
        """
        query = {"contours": contours, "points": points, "paths": paths, "values": name}
        [answer] = self._gifti(depth_mm, query, "case.values()").darrays
        self._warn_if_too_deep(depth_mm)
        return np.array(answer.data, np.float32)

    def isosurface(self, depth_mm: float = 0.0) -> Mesh:
        """The exact surface at a depth, as a closed mesh, which pictures show. Each depth has other vertices.

        >>> case.isosurface(8.0).coordinates.dtype
        dtype('float32')
        """
        query = {"depth_mm": depth_mm, "surface": self._surface, "solid": True}
        answer = self._connection.get(f"{self._path}/mesh", query, "application/ply")
        self._warn_if_too_deep(depth_mm)
        return _mesh_of_ply(answer.content)

    def picture(
        self,
        depth_mm: float = 0.0,
        *,
        view: View | None = None,
        layer: str | None = None,
        overlay: str | None = None,
        width: int = 512,
        height: int = 512,
        annotate: bool = False,
        **options: Any,
    ) -> Picture:
        """The surface at a depth as a PIL image, which a notebook shows, in the intensities of the volume.

        view: from where it is seen; by default from the left.
        layer: an added layer to show instead of the volume.
        overlay: a map or a layer to show in colours above it.
        annotate: whether to draw the scale, the directions and the notice into the picture.
        options: others of the interface, such as `zoom=2`, `slab_mm=1.5`, `window=(80, 90)` (centre and width),
            `projection="map"` or `background="transparent"`.

        >>> case.picture(8.0, view="left", overlay="blur", width=800, height=600).size
        (800, 600)
        """
        options.update(view=view, layer=layer, overlay=overlay, width=width, height=height, annotate=annotate)
        return _picture(self.png(depth_mm, **options))

    def png(self, depth_mm: float = 0.0, **options: Any) -> bytes:
        """The bytes of the PNG of :meth:`picture`, which takes the same options. Needs no other package."""
        return self._render("image/png", depth_mm, options).content

    def positions(self, depth_mm: float = 0.0, **options: Any) -> NDArray[np.float32]:
        """What each pixel of :meth:`picture` shows: scanner RAS in mm, (height, width, 3), NaN where there is nothing.

        >>> case.positions(8.0, view="left").shape
        (512, 512, 3)
        """
        answer = self._render("application/octet-stream", depth_mm, options)
        width, height = map(int, answer.headers["X-Isocortex-Size"].split(","))
        return _positions(answer.content).reshape(height, width, 3)

    def _gifti(self, depth_mm: float, query: dict[str, Any], what: str) -> GiftiImage:
        gifti = nibabel(what).GiftiImage
        query = {"depth_mm": depth_mm, "surface": self._surface, "format": "gifti", **query}
        answer: GiftiImage = gifti.from_bytes(self._connection.get(f"{self._path}/mesh", query).content)
        return answer

    def _render(self, accept: str, depth_mm: float, options: dict[str, Any]) -> httpx.Response:
        query = {"depth_mm": depth_mm, "surface": self._surface, **options}
        answer = self._connection.get(f"{self._path}/render", query, accept)
        self._warn_if_too_deep(depth_mm)
        return answer

    def profile(self, position_mm: tuple[float, float, float]) -> DataFrame:
        """The values along the path from the envelope through a point, and through its mirrored point.

        position_mm: x, y, z in scanner RAS, a point in the brain.

        In rows with the `point` "own" the path leads through the point, in those with "mirrored" through the one on the
        other side, if that is in the brain. `distance_mm` is 0 at the point and negative towards the dura. The other
        columns are `x_mm`, `y_mm`, `z_mm`, `depth_mm`, `intensity`, each map and each added layer, NaN if undefined.
        `attrs["own"]` and `attrs["mirrored"]` state the `side`, the `junction_width` of grey and white matter, and the
        `gyrus` if an atlas is installed.

        >>> profile = case.profile((38, 20, 30))
        >>> profile.attrs["own"]["side"]
        'right'
        >>> own = profile[profile["point"] == "own"]
        >>> depths = own["depth_mm"].to_numpy()
        """
        query = {"position": flipped(position_mm), "surface": self._surface}
        try:
            answer = self._connection.json(f"{self._path}/profile", query)
        except IsocortexError as error:
            if error.kind == "query-value-out-of-range":
                place = ", ".join(f"{number:g}" for number in position_mm)
                raise ValueError(f"({place}) is outside the brain: name a point in it, in scanner RAS mm") from None
            raise
        layers = answer.get("layers", [])
        rows = []
        for point in ("own", "mirrored"):
            for sample in (answer.get(point) or {"samples": []})["samples"]:
                position, values = sample.pop("position_in_patient"), sample.pop("layers", [])
                row = {"point": point, **_xyz(position), **sample}
                for layer, value in zip(layers, values):
                    # Of labels, the interface states which of the list it is, from 1.
                    is_label = value and layer.get("labels")
                    row.setdefault(layer["name"], layer["labels"][int(value) - 1]["value"] if is_label else value)
                rows.append(row)
        table = pandas("case.profile()").DataFrame(rows)
        numbers = table.columns.drop("point")
        table[numbers] = table[numbers].astype(float)
        for point in ("own", "mirrored"):
            if answer.get(point):
                del answer[point]["point"], answer[point]["samples"]
                table.attrs[point] = answer[point]
        result: DataFrame = table
        return result

    def _warn_if_too_deep(self, depth_mm: float) -> None:
        if depth_mm > self.max_depth_mm:
            warn(f"{depth_mm:g} mm is too deep: this is the surface at {self.max_depth_mm:.1f} mm, the greatest depth")


class Case(Surface):
    """A prepared head. Its own surface is that of the whole brain.

    Positions are in scanner RAS, in mm; depths in mm below the envelope.
    """

    def __init__(self, connection: Connection, id: str, *, progress: bool = True) -> None:
        facts = _wait(connection, f"/v1/cases/{id}", progress)
        super().__init__(connection, id, "whole", facts)
        if self.quality != "ok":
            warn(f"look at the brain mask ({self.quality}): {'; '.join(self.quality_reasons)}")
        if "closed" in facts:
            warn(f"this case is closed, because its images were {facts['closed']}: open what replaces it")

    @property
    def name(self) -> str | None:
        """Its label."""
        return self._facts.get("name")

    @property
    def quality(self) -> str:
        """How far the brain mask can be trusted: `"ok"`, `"review"` or `"failed"`."""
        return str(self._facts.get("quality", {}).get("state", "ok"))

    @property
    def quality_reasons(self) -> list[str]:
        """The reasons for :attr:`quality`, in sentences."""
        return list(self._facts.get("quality", {}).get("reasons", []))

    @property
    def info(self) -> dict[str, Any]:
        """All that the server states about it now, in the words of the interface. Positions there are in LPS mm."""
        info: dict[str, Any] = self._connection.json(self._path)
        return info

    def __repr__(self) -> str:
        volume = self._facts["volume"]
        voxels = "×".join(map(str, volume["size"]))
        edges = "×".join(f"{edge:.3g}" for edge in volume["spacing_mm"])
        name = f" {self.name!r}" if self.name else ""
        depths = f"0 to {self.max_depth_mm:.1f} mm deep"
        return f"<Case {self.id[:8]}{name}: {voxels} voxels of {edges} mm, {depths}, mask {self.quality}>"

    def surface(self, name: SurfaceName) -> Surface:
        """Another surface: `"left"` or `"right"`, a half of the cerebrum, closed along the falx, or the `"cerebrum"`.

        It has the methods of a case that depend on depth. If the parts of the brain are in doubt, this is an
        :class:`IsocortexError` with the reason.

        >>> left = case.surface("left")
        >>> mesh, picture = left.mesh(8.0), left.picture(8.0, view="mesial-left")
        """
        return Surface(self._connection, self.id, name, self._connection.json(self._path, {"surface": name}))

    def slice(self, plane: Plane, position_mm: float, **options: Any) -> Picture:
        """A slice through the volume as it was acquired, as a PIL image. The patient's right is on the left.

        position_mm: the coordinate of the plane, in scanner RAS: z of an axial, y of a coronal, x of a sagittal slice.
        options: others of the interface, such as `depth_mm=(5, 10)` for the contours of cuts, `overlay="blur"`,
            `convention="neurological"` (left on the left), `width=800` or `annotate=True`.

        >>> picture = case.slice("axial", 30, depth_mm=(5, 10), overlay="blur")
        """
        along_lps = position_mm if plane == "axial" else -position_mm
        query = {"position_mm": along_lps, **options}
        return _picture(self._connection.get(f"{self._path}/slices/{plane}", query, "image/png").content)

    def map(self, name: str) -> Nifti1Image:
        """Values of the voxels of this head, or an added layer, as a nibabel image in scanner space.

        The maps are `"blur"`, `"thickness"`, `"sharpness"`, `"asymmetry"`, `"intensity-asymmetry"` and `"junction"`,
        and `"flair"` if a FLAIR was added; NaN where they are undefined. They are computed after the head is prepared:
        the first call waits. `"depth"` is the depth below the dura in mm, NaN outside. `"brain"` (1 inside), `"sides"`
        (1 left, 2 right, 3 within 5 mm of the plane between the hemispheres, 4 unknown), `"regions"` (1 and 2 left and
        right cerebrum, 3 cerebellum, 4 brain stem, 5 and 6 left and right without cortex) and `"blur-places"`,
        `"thickness-places"` and `"flair-places"` (the ranks of :meth:`places`) are labels.

        All of them have the grid of the volume as it was acquired. A layer that you added has its own, and comes first
        if it has one of these names.

        >>> blur, depth = case.map("blur"), case.map("depth")
        >>> blur.shape == depth.shape
        True
        """
        try:
            file = self._connection.get(f"{self._path}/layers/{quote(name, safe='')}/nifti")
        except IsocortexError as error:
            if error.kind != "no-such-layer" or name not in VOXELS:
                raise
            file = self._connection.get(f"{self._path}/nifti", {"values": name})
        return _image(file.content, "case.map()")

    def mask(self) -> Nifti1Image:
        """The brain mask as a nibabel image, 1 inside, on an isotropic grid along the axes of the scanner."""
        return _image(self._connection.get(f"{self._path}/mask").content, "case.mask()")

    def places(self, map: ListedMap = "blur", *, limit: int = 20, region: Region = "cerebrum") -> DataFrame:
        """The highest places of a map, highest first, as a pandas table. **Most are normal: nothing is detected.**

        Columns: `x_mm`, `y_mm`, `z_mm` (scanner RAS), `depth_mm`, `side`, `gyrus` (if an atlas is installed), `region`,
        `score` (a robust z of this head), `size_mm` (diameter), and `unusual`: whether the score is higher than in
        heads without a lesion (`"yes"`, `"borderline"`, `"no"`), if that is known. `attrs["nothing_stands_out"]` does
        not exclude a lesion. If there is a caveat, a warning states it.

        >>> places = case.places(limit=5)
        >>> coordinates = places[["x_mm", "y_mm", "z_mm"]].to_numpy()
        """
        answer = self._connection.json(f"{self._path}/candidates", {"map": map, "limit": limit, "region": region})
        columns = [*XYZ, "depth_mm", "side", "gyrus", "region", "score", "size_mm", "unusual"]
        rows = [{**_xyz(place["position_in_patient"]), **place} for place in answer["candidates"]]
        table: DataFrame = pandas("case.places()").DataFrame(rows, columns=columns)
        stated = ("nothing_stands_out", "limits", "caveat")
        table.attrs.update({name: answer[name] for name in stated if name in answer})
        if "caveat" in answer:
            warn(answer["caveat"]["reason"])
        return table

    def findings(self) -> DataFrame:
        """What readers have marked, as a pandas table.

        Columns: `id`, `kind` (point, line, polygon or trajectory), `label`, `certainty`, `side`, `gyrus`, `depth_mm`,
        `x_mm`, `y_mm`, `z_mm` (the middle of its points, scanner RAS), `points_mm` (the points, (n, 3)), `note`,
        `author`, `is_dismissed`, `is_unconfirmed`, `changed_at`.

        >>> len(case.findings())
        0
        """
        columns = ["id", "kind", "label", "certainty", "side", "gyrus", "depth_mm", *XYZ, "points_mm", "note", "author"]
        columns += ["is_dismissed", "is_unconfirmed", "changed_at"]
        rows = []
        for finding in self._connection.json(f"{self._path}/findings")["findings"]:
            points = np.array(finding["points_in_patient"], dtype=float)
            rows.append({"is_unconfirmed": False, **finding, **_xyz(points.mean(axis=0)), "points_mm": flipped(points)})
        table: DataFrame = pandas("case.findings()").DataFrame(rows, columns=columns)
        return table

    def report(self, path: str | os.PathLike[str], *, language: Language = "en", patient: bool = False) -> Path:
        """Writes the report of the reading, one file that needs no other: `.html` or `.pdf`. Returns its path.

        patient: whether it names the patient, if the head came as DICOM.

        >>> case.report("report.html")
        PosixPath('report.html')
        """
        path = Path(path)
        types = {".html": "text/html", ".pdf": "application/pdf"}
        if path.suffix not in types:
            raise ValueError(f"a report is .html or .pdf: rename {path.name!r}")
        query = {"language": language, "patient": patient}
        path.write_bytes(self._connection.get(f"{self._path}/report", query, types[path.suffix]).content)
        return path

    def to_freesurfer(
        self,
        folder: str | os.PathLike[str],
        depths_mm: Sequence[float] = (0.0, 8.0),
        *,
        values: Sequence[ValueName] = ("intensity",),
        contours: int = 100,
        points: int = 100,
        paths: Paths = "forest",
    ) -> Path:
        """Writes the case into a new folder, as FreeSurfer lays out a subject. Returns its path.

        `mri/T1.mgz` has the volume as it was acquired, neither resampled nor conformed to FreeSurfer's 256³ voxels,
        `mri/brainmask.mgz` the same within the brain mask. `surf/lh.cut-8mm` and `surf/rh.cut-8mm` are the halves 8 mm
        deep, and `surf/lh.cut-8mm.blur` has the :meth:`values` of its vertices. **White and pial are not made.** As
        always in FreeSurfer, coordinates are in tkregister RAS of a volume: that of T1.mgz, which each file states.

        All cuts of a half have the same vertices. Those of unknown depth have a position, no triangles, and NaN as
        their value. If the halves are in doubt, this is an :class:`IsocortexError` with the reason.

        >>> case.to_freesurfer("subjects/1", depths_mm=(5, 10), values=("intensity", "blur"))
        PosixPath('subjects/1')
        """
        path = Path(folder)
        write_subject(self, path, depths_mm, values, {"contours": contours, "points": points}, paths)
        return path

    def layers(self) -> list[dict[str, Any]]:
        """What the server states about the layers: those that were added or came with a FreeSurfer folder, and maps.

        Their `name`s are what :meth:`map` takes; `labels` has the names of the numbers of a label layer.
        """
        layers: list[dict[str, Any]] = self._connection.get(f"{self._path}/layers").json()["layers"]
        return layers

    def add_layer(self, volume: Image, name: str, *, progress: bool = True, **parameters: Any) -> dict[str, Any]:
        """Adds another volume of the same head, which pictures, maps and profiles then know by its name.

        volume: as for :func:`isocortex.open`.
        parameters: those of the interface: `kind`, `"mr"` (the default), `"ct"` or `"pet"`, which are registered with
            the head, or `"map"` or `"labels"`, which lie where their header places them; `contrast="flair"`;
            `unit="z"`; `transform="none"`, or a rigid matrix (4, 4) from the scanner RAS of the layer to that of the
            head.

        Returns what the server states about it, with transforms in LPS. If its place is in doubt, a warning says so.
        """
        transform = parameters.get("transform")
        if transform is not None and not isinstance(transform, str):
            parameters["transform"] = (FLIP @ np.asarray(transform, dtype=float) @ FLIP).tolist()
        with opened(volume) as file:
            answer = upload(self._connection, f"{self._path}/layers", {"volume": file}, {"name": name, **parameters})
        layer = _wait(self._connection, f"{self._path}/layers/{answer['id']}", progress)
        if layer.get("quality", "ok") != "ok":
            warn(f"look at where the layer {name!r} lies ({layer['quality']})")
        return layer

    def delete(self) -> None:
        """Deletes the case, its layers and its findings from the server."""
        self._connection.send("DELETE", self._path)


def _wait(connection: Connection, path: str, progress: bool) -> dict[str, Any]:
    """The case or layer at a path, once it is ready."""
    with Bar(progress) as bar:
        while True:
            now: dict[str, Any] = connection.json(path)
            if now["state"] == "ready":
                bar.show(1.0, "ready")
                return now
            if now["state"] == "failed":
                raise IsocortexError.of(now["error"])
            at = now.get("progress") or {"fraction": 0.0, "stage": now["state"]}
            bar.show(at["fraction"], at["stage"])
            time.sleep(POLL_EVERY_S)


def _positions(content: bytes) -> NDArray[np.float32]:
    """The positions of an answer, in RAS mm."""
    return flipped(np.frombuffer(content, "<f4").reshape(-1, 3).astype(np.float32))


def _xyz(lps: Any) -> dict[str, float]:
    """The columns of a position."""
    return dict(zip(XYZ, flipped(lps).tolist()))


def _mesh_of_ply(content: bytes) -> Mesh:
    """A mesh out of the binary PLY that the program writes: vertices of three f32, then triangles."""
    header, body = content.split(b"end_header\n", 1)
    counts = dict(line.split()[1:] for line in header.splitlines() if line.startswith(b"element"))
    vertices, triangles = int(counts[b"vertex"]), int(counts[b"face"])
    faces = np.frombuffer(body, np.dtype([("count", "u1"), ("vertices", "<u4", 3)]), triangles, 12 * vertices)
    return Mesh(_positions(body[: 12 * vertices]), faces["vertices"].astype(np.int32))


def _picture(png: bytes) -> Picture:
    picture: Picture = pillow("a picture").open(io.BytesIO(png))
    picture.load()
    return picture


def _image(content: bytes, what: str) -> Nifti1Image:
    """The nibabel image of a `.nii.gz`."""
    image: Nifti1Image = nibabel(what).Nifti1Image.from_bytes(gzip.decompress(content))
    return image
