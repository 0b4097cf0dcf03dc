"""A flow sculpture film: shots are simulated, shaded, framed, rendered, denoised and encoded.

    simulate ─┬─ smooth_normals ─┬─ render ─ finish ─┬─ assemble    renders/{shot}/{quality}/{shot}.mp4
              └─ frame_camera ───┘                   ├─ film        renders/film/{quality}/{edit}.mp4
                                                     └─ stills      renders/{shot}/{quality}/png

`snakemake --cores 2` makes the film; `--config shot=A020_lorenz frames=10-20x2 quality=daily` frames of a
shot, `edit=showreel` another film; `renders/A010_cube/draft/frames/A010_cube.0010.exr` is one frame.

Files in the store have keys: digests of all that they are made from. A done-file lists the keys of what one
job has made, and has their digest in its name: an edited shot asks for other names. While Snakemake builds
its graph, done-files are compared with the store, so a stale one counts as missing.
"""

from flowsculpt.pipeline.production.execution.snakefile import (
    JOB_PROCESS,
    PlannedWorkflow,
)

plan = PlannedWorkflow(workflow, config)

DONE, LOGS = ".flowsculpt/done", ".flowsculpt/logs/jobs"
# A message takes the place of the line `rule NAME:` in Snakemake's log, and so begins with it.
# What farms and plain Snakemake start; on this machine the executor hands jobs to the pool of workers.
TASK = f"exec {JOB_PROCESS} {{params.job}} --threads {{threads}} --log {{log:q}}"


wildcard_constraints:
    shot=r"(?!film/).+",
    quality=r"[^/]+",
    form=r"png|png16|jpeg",
    stage=r"\w+\.\w+",
    movie=r"[^/]+",
    name=r"[^/]+",
    frames=r"-?\d+--?\d+",
    number=r"-?\d+",
    key=r"[0-9a-f]{16}",


localrules:
    all,
    shots,
    frame,
    smooth_normals,
    frame_camera,
    assemble,
    film,
    stills,


rule all:
    """Everything that was asked for: by default the film."""
    default_target: True
    input:
        lambda w: plan.targets,


rule shots:
    """Simulate, shade and frame the shots; render nothing."""
    input:
        lambda w: plan.targets,


rule simulate:
    """Move and resample the surface, frame by frame, going on from the last frame that the store holds."""
    input:
        lambda w: plan.inputs("simulate", w, "simulate"),
    output:
        f"{DONE}/{{shot}}/simulate/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/simulate/{{frames}}.{{key}}.log",
    retries: 2
    threads: lambda w: plan.threads("simulate", w)
    resources:
        mem_mb=lambda w, attempt: plan.memory("simulate", w) * attempt,
        runtime=lambda w, attempt, threads: plan.minutes(
            "simulate", w, threads, attempt
        ),
    params:
        job=lambda w, output: plan.words("simulate", w),
    message:
        "\nrule simulate: {wildcards.shot}, frames {wildcards.frames}"
    shell:
        TASK


rule smooth_normals:
    """Give vertices the normals that light sees, split at creases."""
    input:
        lambda w: plan.inputs("smooth_normals", w, "simulate"),
    output:
        f"{DONE}/{{shot}}/smooth_normals/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/smooth_normals/{{frames}}.{{key}}.log",
    resources:
        mem_mb=lambda w, attempt: plan.memory("smooth_normals", w) * attempt,
    params:
        job=lambda w, output: plan.words("smooth_normals", w),
    message:
        "\nrule smooth_normals: {wildcards.shot}, frames {wildcards.frames}"
    shell:
        TASK


rule frame_camera:
    """Find the camera and the stage of every picture from where the sculpture is in all of them."""
    input:
        lambda w: plan.inputs("frame_camera", w, "simulate"),
    output:
        f"{DONE}/{{shot}}/frame_camera/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/frame_camera/{{frames}}.{{key}}.log",
    resources:
        mem_mb=lambda w, attempt: plan.memory("frame_camera", w) * attempt,
    params:
        job=lambda w, output: plan.words("frame_camera", w),
    message:
        "\nrule frame_camera: {wildcards.shot}"
    shell:
        TASK


rule render:
    """Render raw pictures with their auxiliary features, in Mitsuba."""
    input:
        lambda w: plan.inputs("render", w, "smooth_normals"),
        lambda w: plan.inputs("render", w, "frame_camera"),
        lambda w: plan.inputs("render", w, "simulate"),  # where pictures read meshes too
    output:
        f"{DONE}/{{shot}}/{{quality}}/render/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/{{quality}}/render/{{frames}}.{{key}}.log",
    retries: 2
    threads: lambda w: plan.threads("render", w)
    resources:
        mem_mb=lambda w, attempt: plan.memory("render", w) * attempt,
        runtime=lambda w, attempt, threads: plan.minutes("render", w, threads, attempt),
        gpu=lambda w: plan.gpus("render", w),
    params:
        job=lambda w, output: plan.words("render", w),
    message:
        "\nrule render: {wildcards.shot}, frames {wildcards.frames} at {wildcards.quality}"
    shell:
        TASK


rule plug_in:
    """Do the stage of a plug-in on rendered pictures, before they are denoised."""
    input:
        lambda w: plan.plugin_inputs(w.stage, w),
    output:
        f"{DONE}/{{shot}}/{{quality}}/{{stage}}/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/{{quality}}/{{stage}}/{{frames}}.{{key}}.log",
    retries: 2
    threads: lambda w: plan.threads(w.stage, w)
    resources:
        mem_mb=lambda w, attempt: plan.memory(w.stage, w) * attempt,
        runtime=lambda w, attempt, threads: plan.minutes(w.stage, w, threads, attempt),
    params:
        job=lambda w, output: plan.words(w.stage, w),
    message:
        "\nrule plug_in: {wildcards.stage}, {wildcards.shot}, frames {wildcards.frames} at {wildcards.quality}"
    shell:
        TASK


rule finish:
    """Denoise pictures, over time too."""
    input:
        lambda w: plan.inputs("finish", w, "render"),
        lambda w: plan.plugin_inputs("finish", w),
    output:
        f"{DONE}/{{shot}}/{{quality}}/finish/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/{{quality}}/finish/{{frames}}.{{key}}.log",
    priority: 1  # what can be looked at comes first
    retries: 2
    threads: lambda w: plan.threads("finish", w)
    resources:
        mem_mb=lambda w, attempt: plan.memory("finish", w) * attempt,
        runtime=lambda w, attempt, threads: plan.minutes("finish", w, threads, attempt),
    params:
        job=lambda w, output: plan.words("finish", w),
    message:
        "\nrule finish: {wildcards.shot}, frames {wildcards.frames} at {wildcards.quality}"
    shell:
        TASK


rule assemble:
    """Encode the movie of a shot."""
    input:
        lambda w: plan.inputs("assemble", w, "finish"),
    output:
        update("renders/{shot}/{quality}/{movie}.mp4"),
    log:
        f"{LOGS}/{{shot}}/{{quality}}/{{movie}}.log",
    resources:
        mem_mb=lambda w, attempt: plan.memory("assemble", w) * attempt,
    params:
        job=lambda w, output: plan.words("assemble", w),
        key=lambda w: plan.movie_key("assemble", w),
    message:
        "\nrule assemble: {output}"
    shell:
        TASK


rule film:
    """Encode the film of an edit: title, shots, credits, sound."""
    input:
        lambda w: plan.inputs("film", w, "finish"),
    output:
        update("renders/film/{quality}/{movie}.mp4"),
    log:
        f"{LOGS}/film/{{quality}}/{{movie}}.log",
    resources:
        mem_mb=lambda w, attempt: plan.memory("film", w) * attempt,
    params:
        job=lambda w, output: plan.words("film", w),
        key=lambda w: plan.movie_key("film", w),
    message:
        "\nrule film: {output}"
    shell:
        TASK


rule stills:
    """Write finished frames as a display shows them: PNG or JPEG."""
    input:
        lambda w: plan.inputs(w.form, w, "finish"),
    output:
        f"{DONE}/{{shot}}/{{quality}}/{{form}}/{{frames}}.{{key}}",
    log:
        f"{LOGS}/{{shot}}/{{quality}}/{{form}}/{{frames}}.{{key}}.log",
    resources:
        mem_mb=lambda w, attempt: plan.memory(w.form, w) * attempt,
    params:
        job=lambda w, output: plan.words(w.form, w),
    message:
        "\nrule stills: {wildcards.shot}, frames {wildcards.frames} as {wildcards.form}"
    shell:
        TASK


rule frame:
    """Make one finished frame, which the job that denoises it shows."""
    input:
        lambda w: plan.frame_inputs(w),
    output:
        update("renders/{shot}/{quality}/frames/{name}.{number}.exr"),
    message:
        "\nrule frame: {output}"
    shell:
        "test -e {output:q}"
