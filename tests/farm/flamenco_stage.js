// Stands for Flamenco Manager: loads a job type and compiles a job, as its documentation tells.
//
//   node flamenco_stage.js SCRIPT.js JOB.json
//
// It prints the tasks as JSON. What Flamenco does not document is refused: functions, fields of a
// setting, types, commands and their parameters, and a job without what the API needs.
"use strict";
const fs = require("fs");
const vm = require("vm");

const SETTING_FIELDS = {
    key: "string", type: "string", subtype: "string", choices: "object", propargs: "object",
    description: "string", default: "any", eval: "string", evalInfo: "object", visible: "string",
    required: "boolean", editable: "boolean",
};
const SETTING_TYPES = { string: "string", int32: "number", float: "number", bool: "boolean" };
const SUBTYPES = ["file_path", "dir_path", "file_name", "hashed_file_path"];
const VISIBLE = ["visible", "hidden", "submission", "web"];
const JOB_FIELDS = ["name", "type", "type_etag", "priority", "settings", "metadata",
    "submitter_platform", "storage", "worker_tag"];
const JOB_NEEDS = { name: "string", type: "string", priority: "number", submitter_platform: "string" };
const TASK_TYPES = ["blender", "ffmpeg", "file-management", "misc"];
const COMMANDS = {
    "blender-render": { exe: "string", exeArgs: "string", argsBefore: "words", blendfile: "string",
        args: "words" },
    "exec": { exe: "string", args: "words" },
    "echo": { message: "string" },
    "sleep": { duration_in_seconds: "number" },
};

function check(holds, text) {
    if (!holds) {
        throw new Error(text);
    }
}

// An object that refuses what it does not have.
function sealed(name, object) {
    return new Proxy(object, {
        get(target, key) {
            check(key in target || typeof key == "symbol", `${name}.${String(key)} is unknown`);
            return target[key];
        },
        set(target, key) {
            throw new Error(`${name}.${String(key)} cannot be set`);
        },
    });
}

function checkParameters(name, parameters) {
    check(name in COMMANDS, `unknown command ${name}`);
    for (const [key, value] of Object.entries(parameters)) {
        const kind = COMMANDS[name][key];
        check(kind, `${name}: unknown parameter ${key}`);
        const fits = kind == "words"
            ? Array.isArray(value) && value.every(word => typeof word == "string")
            : typeof value == kind;
        check(fits, `${name}: ${key}: expected ${kind}, got ${JSON.stringify(value)}`);
    }
    check(parameters.exe || !COMMANDS[name].exe, `${name}: expected an exe`);
}

function task(name, type) {
    check(name && name.trim(), "author.Task: expected a name");
    check(TASK_TYPES.includes(type), `unknown task type ${type}`);
    const content = { name, type, commands: [], dependencies: [] };
    return sealed("task", {
        content,
        addCommand: command => content.commands.push(command.content),
        addDependency: other => content.dependencies.push(other.content.name),
    });
}

function command(name, parameters) {
    checkParameters(name, parameters);
    // Values cross into Go, and later into JSON.
    return sealed("command", { content: JSON.parse(JSON.stringify({ name, parameters })) });
}

function frames(range) {
    const numbers = new Set();
    for (const part of range.replaceAll("..", "-").split(",")) {
        const ends = part.split("-").map(word => word.trim());
        check(ends.length <= 2 && ends.every(word => /^\d+$/.test(word)), `bad range ${range}`);
        for (let frame = Number(ends[0]); frame <= Number(ends.at(-1)); frame++) {
            numbers.add(frame);
        }
    }
    return [...numbers].sort((a, b) => a - b);
}

// A run of two frames becomes "1,2", a longer one "1-3".
function merge(list) {
    const runs = [];
    for (const frame of list) {
        const run = runs.at(-1);
        if (run && frame == run[1] + 1) {
            run[1] = frame;
        } else {
            runs.push([frame, frame]);
        }
    }
    return runs.map(([first, last]) => first == last ? `${first}`
        : first + 1 == last ? `${first},${last}` : `${first}-${last}`).join(",");
}

function frameChunker(range, size) {
    check(typeof range == "string" && size >= 1, "frameChunker: expected a range and a size");
    const list = frames(range), chunks = [];
    for (let at = 0; at < list.length; at += size) {
        chunks.push(merge(list.slice(at, at + size)));
    }
    return chunks;
}

// The words of a command line by the rules of shells: quotes and backslashes.
function shellSplit(text) {
    check(typeof text == "string", "shellSplit: expected a string");
    const words = [];
    const pattern = /\s*((?:'[^']*'|"(?:\\.|[^"\\])*"|\\.|[^\s'"\\])+)/gy;
    for (const [, raw] of text.matchAll(pattern)) {
        words.push(raw.replace(/'([^']*)'|"((?:\\.|[^"\\])*)"|\\(.)/g, (_, plain, quoted, one) =>
            plain ?? quoted?.replace(/\\(["\\$`])/g, "$1") ?? one));
    }
    return words;
}

function checkSettings(jobType) {
    check(typeof jobType.label == "string", "JOB_TYPE.label: expected text");
    const keys = new Set();
    for (const setting of jobType.settings) {
        for (const [field, value] of Object.entries(setting)) {
            const kind = SETTING_FIELDS[field];
            check(kind, `setting ${setting.key}: unknown field ${field}`);
            check(kind == "any" || typeof value == kind, `setting ${setting.key}: ${field}: ${kind}`);
        }
        const type = SETTING_TYPES[setting.type];
        check(type, `setting ${setting.key}: unknown type ${setting.type}`);
        check(SUBTYPES.includes(setting.subtype ?? SUBTYPES[0]), `${setting.key}: subtype`);
        check(VISIBLE.includes(setting.visible ?? VISIBLE[0]), `${setting.key}: visible`);
        check(!("default" in setting) || typeof setting.default == type, `${setting.key}: default`);
        check(!keys.has(setting.key), `setting ${setting.key}: twice`);
        keys.add(setting.key);
    }
}

function checkJob(job, jobType) {
    for (const [field, type] of Object.entries(JOB_NEEDS)) {
        check(typeof job[field] == type, `job: ${field}: expected a ${type}`);
    }
    for (const field of Object.keys(job)) {
        check(JOB_FIELDS.includes(field), `job: unknown field ${field}`);
    }
    for (const setting of jobType.settings) {
        const value = job.settings[setting.key];
        check(value !== undefined || !setting.required, `job: ${setting.key} is missing`);
        check(value === undefined || typeof value == SETTING_TYPES[setting.type],
            `job: ${setting.key}: expected ${setting.type}`);
    }
    for (const key of Object.keys(job.settings)) {
        check(jobType.settings.some(setting => setting.key == key), `job: unknown setting ${key}`);
    }
}

function main(script, jobFile) {
    const tasks = [];
    const path = { basename: require("path").posix.basename, dirname: require("path").posix.dirname,
        join: require("path").posix.join,
        stem: file => require("path").posix.parse(file).name };
    const process = { platform: "linux" };
    const known = { print() {}, alert() {}, frameChunker, frameCount: range => frames(range).length,
        formatTimestampLocal: () => "2026-01-01_000000", shellSplit,
        author: sealed("author", { Task: task, Command: command }), path: sealed("path", path),
        process: sealed("process", process) };
    const context = vm.createContext(known);
    vm.runInContext("delete globalThis.console; delete globalThis.WebAssembly;", context);
    const source = `"use strict";${fs.readFileSync(script, "utf8")}\n[JOB_TYPE, compileJob]`;
    const [jobType, compileJob] = vm.runInContext(source, context, { filename: script });
    checkSettings(jobType);
    const submitted = JSON.parse(fs.readFileSync(jobFile, "utf8"));
    checkJob(submitted, jobType);
    compileJob(sealed("job", { ...submitted, created: new Date(),
        addTask: added => tasks.push(added.content) }));
    const names = tasks.map(each => each.name);
    for (const each of tasks) {
        check(each.dependencies.every(name => names.includes(name)), `${each.name}: its dependency`);
        check(names.filter(name => name == each.name).length == 1, `${each.name}: twice`);
    }
    console.log(JSON.stringify(tasks));
}

main(...process.argv.slice(2));
