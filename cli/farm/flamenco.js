// The shots of a jobs file as a job type of Flamenco 3: a task bakes a chunk of rows, and where
// renders are asked for, more tasks render the .blend of each row after that.
//
// Copy this file as `anyface.js` into the folder `scripts` beside flamenco-manager, once. It is the
// same for all jobs; `anyface batch --export flamenco` writes the settings of one into `job.json`.
const JOB_TYPE = {
    label: "Anyface: faces that talk",
    description: "Bake the rows of an Anyface jobs file, and render them if wanted",
    settings: [
        { key: "jobs", type: "string", subtype: "file_path", required: true,
          description: "The jobs file, at a path that all workers know" },
        { key: "rows", type: "int32", required: true, propargs: { min: 1 },
          description: "How many rows the jobs file has" },
        { key: "chunk_size", type: "int32", default: 20, propargs: { min: 1 }, visible: "submission",
          description: "How many rows one task bakes, in one Blender" },
        { key: "command", type: "string", default: "{blender} -b --command anyface batch",
          visible: "submission", description: "What a worker runs, before the jobs file" },
        { key: "options", type: "string", default: "", visible: "submission",
          description: "More options of the batch, such as --map P:/=/mnt/p" },
        { key: "render_output_root", type: "string", subtype: "dir_path", default: "",
          visible: "submission",
          description: "Where frames are written, a folder a row. Empty: nothing is rendered" },
        { key: "frames", type: "string", default: "", visible: "submission",
          description: "Frames to render of each row. Examples: '47', '1-30', '3, 5-10'" },
        { key: "frames_per_task", type: "int32", default: 50, propargs: { min: 1 },
          visible: "submission", description: "How many frames one task renders" },
        { key: "format", type: "string", default: "PNG", visible: "submission",
          description: "Format of rendered frames, as Blender's --render-format has it" },
        { key: "blendfiles", type: "string", default: "[]", visible: "hidden",
          description: "The .blend that each row writes, as a JSON list" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const words = batchWords(settings);
    const sum = author.Task("sum", "blender");
    sum.addCommand(run(words.concat(["--sum"])));
    const blendfiles = settings.render_output_root ? renderedFiles(settings) : [];
    // Not by frameChunker(): of two rows it makes "1,2".
    for (let first = 1; first <= settings.rows; first += settings.chunk_size) {
        const last = Math.min(first + settings.chunk_size - 1, settings.rows);
        const task = author.Task(`rows-${first}-${last}`, "blender");
        task.addCommand(run(words.concat(["--rows", `${first}-${last}`])));
        job.addTask(task);
        sum.addDependency(task);
        for (const blendfile of blendfiles.slice(first - 1, last)) {
            addRenders(job, settings, blendfile, task);
        }
    }
    job.addTask(sum);
}

function batchWords(settings) {
    const command = shellSplit(settings.command || "{blender} -b --command anyface batch");
    return command.concat([settings.jobs], shellSplit(settings.options || ""));
}

function run(words) {
    return author.Command("exec", { exe: words[0], args: words.slice(1) });
}

function renderedFiles(settings) {
    const files = JSON.parse(settings.blendfiles || "[]");
    if (files.length != settings.rows) {
        throw `blendfiles: expected ${settings.rows} paths to render, got ${files.length}`;
    }
    if (!settings.frames) {
        throw "frames: expected frames to render, such as '1-30', got none";
    }
    return files;
}

function addRenders(job, settings, blendfile, bake) {
    // A row that cannot be right writes nothing.
    if (!blendfile) {
        return;
    }
    const stem = path.stem(blendfile);
    for (const frames of frameChunker(settings.frames, settings.frames_per_task)) {
        const task = author.Task(`render-${stem}-${frames}`, "blender");
        task.addCommand(author.Command("blender-render", {
            exe: "{blender}",
            exeArgs: "{blenderArgs}",
            argsBefore: [],
            blendfile: blendfile,
            args: [
                "--render-output", path.join(settings.render_output_root, stem, "######"),
                "--render-format", settings.format || "PNG",
                // Blender writes ranges with two dots.
                "--render-frame", frames.replace(/-/g, ".."),
            ],
        }));
        task.addDependency(bake);
        job.addTask(task);
    }
}
