// The job type "flowsculpt" of Flamenco 3. Flamenco Manager takes it from the folder `scripts` next to its executable.
// `flowsculpt export flamenco SHOT` writes jobs of this type, and this file next to them.

const JOB_TYPE = {
    label: "flowsculpt",
    description: "Simulate, render and assemble shots by a plan that `flowsculpt export flamenco` has written",
    settings: [
        { key: "plan", type: "string", subtype: "file_path", required: true,
          description: "The plan, under a path that all workers see" },
        { key: "root", type: "string", subtype: "dir_path", required: true,
          description: "Where outputs and the store lie, as the workers see it" },
        { key: "store", type: "string", default: "",
          description: "The remote store, where workers have roots of their own; or nothing" },
        { key: "executable", type: "string", default: "flowsculpt",
          description: "The command on the workers, or a variable of the Manager such as {flowsculpt}" },
        { key: "chunk_size", type: "int32", default: 0,
          description: "Frames that a task renders, or finishes; 0: as many as the plan says" },
        { key: "steps", type: "string", required: true, visible: "web",
          description: "The steps of the plan, as JSON: each has a name, tasks, frames, and the steps it waits for" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const made = []; // the tasks of each step
    for (const step of JSON.parse(settings.steps)) {
        const chunks = chunksOf(step.frames, settings.chunk_size || step.chunk);
        const tasks = chunks.map((chunk) => taskOf(step, chunk, settings));
        for (const task of tasks) {
            step.after.forEach((place) => made[place].forEach((earlier) => task.addDependency(earlier)));
            job.addTask(task);
        }
        made.push(tasks);
    }
}

// Frames in parts of some each; one part without frames where one task does it all.
function chunksOf(frames, size) {
    if (size < 0) {
        throw new Error(`chunk_size is ${size}; it must be at least 1, or 0 for as many as the plan says`);
    }
    const chunks = [];
    for (let first = 0; first < frames.length; first += size) {
        chunks.push(frames.slice(first, first + size));
    }
    return chunks.length ? chunks : [[]];
}

function taskOf(step, chunk, settings) {
    const suffix = chunk.length ? `:${chunk.join(",")}` : "";
    const given = ["task", settings.plan, "--root", settings.root];
    const args = given.concat(settings.store ? ["--store", settings.store] : []);
    const name = chunk.length ? `${step.name} ${chunk[0]} to ${chunk[chunk.length - 1]}` : step.name;
    const task = author.Task(name, "misc");
    const words = args.concat(step.tasks.map((each) => `${each}${suffix}`));
    task.addCommand(author.Command("exec", { exe: settings.executable, args: words }));
    return task;
}
