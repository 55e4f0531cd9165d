"""What other programs do in the place of a step of Isocortex.

Each function prepares its input and gives a function without arguments that does the step once and returns a number of its
result, by which the two programs are held against one another. Only public packages are used, each by its own interface.
"""

import io

import numpy as np

DEPTH_MM = 10.0
SIDE = 512


def _array(image):
    return np.ascontiguousarray(np.asanyarray(image.dataobj).T)


class Inputs:
    """The head, its mask, and the envelope as Isocortex made it; arrays are indexed z, y, x."""

    def __init__(self, volume, mask, envelope, closing_mm):
        import nibabel

        self.volume_path = volume
        self.closing_mm = closing_mm
        self.volume_image = nibabel.load(volume)
        self.mask_image = nibabel.load(mask)
        self.envelope_image = nibabel.load(envelope)
        self.spacing_mm = float(self.envelope_image.header.get_zooms()[0])
        self.inside = _array(self.envelope_image) > 0
        self.brain = _array(self.mask_image) > 0
        self.brain_spacing_mm = float(self.mask_image.header.get_zooms()[0])
        # Voxels that are not on the envelope's border: their distance to the nearest that is on it, or outside, is the depth.
        from scipy.ndimage import binary_erosion

        self.below_border = binary_erosion(self.inside)
        self._distance = None

    def padded_brain(self):
        """The brain, cropped, with room for the closing around it."""
        room = int(np.ceil(self.closing_mm / self.brain_spacing_mm)) + 2
        box = tuple(slice(places.min(), places.max() + 1) for places in np.nonzero(self.brain))
        return np.pad(self.brain[box], room)

    def distance(self):
        if self._distance is None:
            import edt

            self._distance = edt.edt(self.below_border, anisotropy=(self.spacing_mm,) * 3, parallel=1)
        return self._distance


def decode_nibabel(inputs):
    import nibabel

    return lambda: float(np.asanyarray(nibabel.load(inputs.volume_path).dataobj).size)


def decode_simpleitk(inputs):
    import SimpleITK as sitk

    return lambda: float(sitk.ReadImage(inputs.volume_path).GetNumberOfPixels())


def _closing_by(transform, inputs):
    brain, radius = inputs.padded_brain(), inputs.closing_mm / inputs.brain_spacing_mm

    def close():
        dilated = transform(~brain) <= radius
        return float(np.count_nonzero(transform(dilated) > radius))

    return close


def closing_edt(inputs):
    import edt

    return _closing_by(lambda mask: edt.edt(mask, parallel=1), inputs)


def closing_scipy(inputs):
    from scipy.ndimage import distance_transform_edt

    return _closing_by(distance_transform_edt, inputs)


def closing_simpleitk(inputs):
    import SimpleITK as sitk

    brain = sitk.GetImageFromArray(inputs.padded_brain().astype(np.uint8))
    radius = [round(inputs.closing_mm / inputs.brain_spacing_mm)] * 3

    def close():
        closed = sitk.BinaryMorphologicalClosing(brain, radius, sitk.sitkBall)
        return float(np.count_nonzero(sitk.GetArrayViewFromImage(closed)))

    return close


def distance_edt(inputs):
    import edt

    mask, spacing = inputs.below_border, (inputs.spacing_mm,) * 3
    return lambda: float(edt.edt(mask, anisotropy=spacing, parallel=1).max())


def distance_scipy(inputs):
    from scipy.ndimage import distance_transform_edt

    return lambda: float(distance_transform_edt(inputs.below_border, sampling=inputs.spacing_mm).max())


def distance_simpleitk(inputs):
    import SimpleITK as sitk

    mask = sitk.GetImageFromArray((~inputs.below_border).astype(np.uint8))
    mask.SetSpacing([inputs.spacing_mm] * 3)

    def transform():
        found = sitk.SignedMaurerDistanceMap(mask, squaredDistance=False, useImageSpacing=True)
        return float(sitk.GetArrayViewFromImage(found).max())

    return transform


def core_skimage(inputs):
    from skimage.morphology import local_maxima

    distance = inputs.distance()
    return lambda: float(np.count_nonzero(local_maxima(distance, connectivity=3)))


def forest_dijkstra3d(inputs):
    import dijkstra3d

    source = np.unravel_index(np.argmax(inputs.distance()), inputs.inside.shape)

    def paths():
        found = dijkstra3d.euclidean_distance_field(inputs.inside, source)
        return float(np.count_nonzero(np.isfinite(found) & inputs.inside))

    return paths


def _vtk_distance(inputs):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    distance = np.ascontiguousarray(inputs.distance(), dtype=np.float32)
    image = vtkImageData()
    image.SetDimensions(*distance.shape[::-1])
    image.SetSpacing(*[inputs.spacing_mm] * 3)
    scalars = numpy_to_vtk(distance.ravel(), deep=True)
    scalars.SetName("depth")
    image.GetPointData().SetScalars(scalars)
    return image


def _surface(image, depth_mm):
    from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

    contour = vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.SetValue(0, depth_mm)
    contour.Update()
    return contour.GetOutput()


def depth_vtk(inputs):
    image = _vtk_distance(inputs)
    return lambda: float(_surface(image, DEPTH_MM).GetNumberOfPolys())


def depth_skimage(inputs):
    from skimage.measure import marching_cubes

    distance = inputs.distance()
    return lambda: float(len(marching_cubes(distance, DEPTH_MM)[1]))


def mesh_vtk_pyfqmr(inputs):
    import pyfqmr
    from vtkmodules.util.numpy_support import vtk_to_numpy

    image = _vtk_distance(inputs)

    def mesh():
        surface = _surface(image, 0.5 * inputs.spacing_mm)
        corners = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        simplify = pyfqmr.Simplify()
        simplify.setMesh(vtk_to_numpy(surface.GetPoints().GetData()), corners)
        simplify.simplify_mesh(target_count=1800, verbose=False)
        return float(len(simplify.getMesh()[1]))

    return mesh


def picture_vtk(inputs):
    """The full surface at the depth, grey by its points, drawn off the screen by a device or by Mesa in software, and read back."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkObject
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkRenderWindow, vtkWindowToImageFilter

    # It warns that there is no X server, and takes Mesa.
    vtkObject.GlobalWarningDisplayOff()
    surface = _surface(_vtk_distance(inputs), DEPTH_MM)
    # What the greys are does not matter to the time; that there is one at each point does.
    intensities = np.linspace(0.0, 1.0, surface.GetNumberOfPoints(), dtype=np.float32)
    surface.GetPointData().SetScalars(numpy_to_vtk(intensities, deep=True))
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(surface)
    actor = vtkActor()
    actor.SetMapper(mapper)
    renderer = vtkRenderer()
    renderer.AddActor(actor)
    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(SIDE, SIDE)
    window.AddRenderer(renderer)
    renderer.GetActiveCamera().ParallelProjectionOn()
    renderer.ResetCamera()

    def draw():
        renderer.GetActiveCamera().Azimuth(1.0)
        window.Render()
        grab = vtkWindowToImageFilter()
        grab.SetInput(window)
        grab.ReadFrontBufferOff()
        grab.Update()
        return float(grab.GetOutput().GetNumberOfPoints())

    return draw


def png_pillow(inputs):
    from PIL import Image

    # A slice of the head, stretched to the size of the picture.
    middle = _array(inputs.volume_image).astype(np.float32)
    middle = middle[middle.shape[0] // 2]
    grey = Image.fromarray((255 * middle / max(middle.max(), 1)).astype(np.uint8)).resize((SIDE, SIDE))

    def encode():
        out = io.BytesIO()
        grey.save(out, format="PNG")
        return float(len(out.getvalue()))

    return encode


# For each step of Isocortex: the peers, and what their number must have to do with ours (None: nothing, they make something else).
STAGES = {
    "decode": ([("nibabel", decode_nibabel), ("SimpleITK", decode_simpleitk)], 0.0),
    "closing": ([("edt, twice", closing_edt), ("scipy, twice", closing_scipy), ("SimpleITK", closing_simpleitk)], 0.02),
    "distance": ([("edt", distance_edt), ("scipy", distance_scipy), ("SimpleITK", distance_simpleitk)], 1e-4),
    "core": ([("scikit-image", core_skimage)], None),
    "forest": ([("dijkstra3d", forest_dijkstra3d)], 0.001),
    "mesh": ([("VTK and pyfqmr", mesh_vtk_pyfqmr)], 0.05),
    "depth": ([("VTK FlyingEdges", depth_vtk), ("scikit-image", depth_skimage)], None),
    "picture": ([("VTK", picture_vtk)], None),
    "traced": ([("VTK", picture_vtk)], None),
    "png": ([("Pillow", png_pillow)], None),
}
