/// A job in a worker: worker.js, beside the page, in an instance of the compiled `module`.
export class JobWorker {
    progress = 0;
    /// Whether the worker has the job; else the page has to do it.
    hasBegun = false;
    hasEnded = false;
    /// Nothing if the job has failed.
    result = undefined;

    constructor(module, name, job) {
        // The list is a view of the page's own memory.
        job = job.slice();
        try {
            this.worker = new Worker("./worker.js", { type: "module" });
        } catch {
            this.hasEnded = true;
            return;
        }
        this.worker.onerror = () => this.end();
        this.worker.onmessage = ({ data }) => {
            this.hasBegun = true;
            if (typeof data === "number") {
                this.progress = data;
            } else {
                this.end(data.result);
            }
        };
        this.worker.postMessage({ module, name, job }, [job.buffer]);
    }

    end(result) {
        this.result = result;
        this.hasEnded = true;
        this.terminate();
    }

    terminate() {
        this.worker.terminate();
    }
}

let said = 0;

/// In a worker: tells the page the share of the job that is done.
export function say(progress) {
    if (progress >= said + 0.01) {
        said = progress;
        postMessage(said);
    }
}
