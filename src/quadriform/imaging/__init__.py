"""From an image to points in the world: read, segment, isosurface (paper 5).

Images from files:

    reading              `read_volume`, one function for all formats
    formats              the format of a file, and rules of all readers
    nifti                NIfTI; `nifti_forms` chooses its transform to the world
    simpleitk_images     NRRD and MetaImage; `text_headers` checks their headers
    dicom                DICOM: `dicom_files` finds the files of a series, `dicom_headers` the planes of a file,
                         `dicom_spacing` the distance of slices, `dicom_stack` their order; `dicom_segments` reads
                         segmentations, and `dicom_values` checks values of headers
    volume               the image: its voxels, and their transform to the world
    segments             the segments that a file names, which may overlap

From an image to points on the surface of an object:

    object_choice        what the object is: labels, or what is above a threshold
    segmentation         the object as a mask: `segment`
    voxel_faces          faces between voxels of different tissues, and those where the image cuts the object
    isosurface           the surface between voxels as a mesh, and the errors of its vertices
    image_points         `points_from_image`, and the slice of each point

From an image to points of a left ventricle:

    labels               the parts of a heart by the label conventions of public data sets
    open_cavity          the cavity in a bright wall that is open at its base
    stack_end            the end of a labelled ventricle at which its base is
    thinning             fewer points, evenly spread
    ventricle            `ventricle_from_labels` and `ventricle_from_perfusion`

From files of any kind to points, and to a fit:

    file_points          the points of one file, and how it is read
    ventricle_files      the points of a ventricle from one file
    contour_landmarks    the base and the RV insertions from contours
    frame_series         the points of all frames of a moving object
    fit_files            the public function `fit`
"""
