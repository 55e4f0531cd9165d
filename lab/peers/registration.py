"""Registers the pairs that `registration-errors --pairs DIR` wrote with SimpleITK, and prints how far off it is.

Rigid, Mattes mutual information of 50 bins inside the envelope grown by 8 mm, a tenth of the voxels of images shrunk by 8, 4 and
2 (ours are as coarse), at most 100 regular steps down the gradient each, scales from physical shifts, on one thread. The coarsest
images are begun twice, where the headers place the volumes and with their middles together, and the better goes on. The errors are
the greatest distances at the envelope's border, as in our own table.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import SimpleITK as sitk

MARGIN_MM = 8.0


def grown(envelope, case):
    """The envelope with what surrounds it, on the grid of the case."""
    distance = sitk.SignedMaurerDistanceMap(envelope, squaredDistance=False, useImageSpacing=True)
    distance = sitk.Resample(distance, case, sitk.Transform(), sitk.sitkLinear, 1e3)
    return sitk.Cast(distance <= MARGIN_MM, sitk.sitkUInt8)


def centre_of(mask):
    statistics = sitk.LabelShapeStatisticsImageFilter()
    statistics.Execute(mask)
    return statistics.GetCentroid(1)


def refined(case, mask, layer, start, steps_mm):
    """The transform from the case to the layer, and its metric: the less, the better."""
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsMattesMutualInformation(numberOfHistogramBins=50)
    method.SetMetricSamplingStrategy(method.RANDOM)
    method.SetMetricSamplingPercentage(0.1, seed=1)
    method.SetMetricFixedMask(mask)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(
        learningRate=2.0, minStep=1e-3, numberOfIterations=100, gradientMagnitudeTolerance=1e-8
    )
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel(steps_mm)
    method.SetSmoothingSigmasPerLevel([step / 2 for step in steps_mm])
    method.SmoothingSigmasAreSpecifiedInPhysicalUnitsOn()
    method.SetInitialTransform(start, inPlace=False)
    return method.Execute(case, layer), method.GetMetricValue()


def register(case, mask, layer):
    """The transform from the case to the layer."""
    header = sitk.Euler3DTransform()
    header.SetCenter(centre_of(mask))
    middles = sitk.CenteredTransformInitializer(
        case, layer, sitk.Euler3DTransform(), sitk.CenteredTransformInitializerFilter.GEOMETRY
    )
    begun = []
    for start in (header, middles):
        try:
            begun.append(refined(case, mask, layer, start, [8]))
        except RuntimeError:
            pass  # no samples within the layer
    found, _ = min(begun, key=lambda pair: pair[1])
    return refined(case, mask, layer, found, [4, 2])[0]


def greatest_error_mm(found, truth, border):
    numbers = np.array([float(number) for number in truth.read_text().split()]).reshape(4, 3)
    linear, translation = numbers[:3].T, numbers[3]
    layer_of = np.linalg.solve(linear, (border - translation).T).T
    found_of = np.array([found.TransformPoint(point) for point in border.tolist()])
    return float(np.linalg.norm(found_of - layer_of, axis=1).max())


def row(name, errors, seconds):
    errors = np.sort(errors)
    quantile = lambda share: errors[round((len(errors) - 1) * share)]
    figures = " | ".join(f"{quantile(share):.2f}" for share in (0.5, 0.95, 1.0))
    print(f"| {name} | {len(errors)} | {figures} | {np.mean(seconds):.1f} |")


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("pairs", type=Path)
    arguments.add_argument("--only", default="*", help="a pattern of pairs, such as *-0: the first of each kind")
    arguments = arguments.parse_args()
    folder = arguments.pairs
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)
    errors, seconds = {}, {}
    for head in sorted(folder.glob("head-*")):
        case = sitk.ReadImage(str(head / "case.nii.gz"), sitk.sitkFloat32)
        mask = grown(sitk.ReadImage(str(head / "envelope.nii.gz")), case)
        border = np.loadtxt(head / "border.txt")
        for truth in sorted(path for path in head.glob(f"{arguments.only}.txt") if path.name != "border.txt"):
            kind = truth.stem.rsplit("-", 1)[0]
            layer = sitk.ReadImage(str(truth.with_suffix(".nii.gz")), sitk.sitkFloat32)
            begun = time.process_time()
            try:
                error = greatest_error_mm(register(case, mask, layer), truth, border)
            except (RuntimeError, ValueError):
                error = float("inf")  # it gave up: no samples within the layer
            seconds.setdefault(kind, []).append(time.process_time() - begun)
            errors.setdefault(kind, []).append(error)
            print(f"  {head.name} {truth.stem}: {error:.2f} mm, {seconds[kind][-1]:.1f} s", flush=True)
    print("| pair | pairs | median, mm | 95 %, mm | most, mm | CPU, s |\n|---|---|---|---|---|---|")
    for kind in errors:
        row(kind, errors[kind], seconds[kind])
    row("all", sum(errors.values(), []), sum(seconds.values(), []))


if __name__ == "__main__":
    main()
