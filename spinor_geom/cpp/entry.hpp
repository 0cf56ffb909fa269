// Functions that Python calls: exceptions become codes, and long loops look at a time limit.

#pragma once

#include <chrono>
#include <cstddef>
#include <new>
#include <stdexcept>

#ifdef _WIN32
#define ENTRY_POINT extern "C" __declspec(dllexport)
#else
#define ENTRY_POINT extern "C"
#endif

// Thrown where the time is over and there is no result yet.
struct OutOfTime {};

// What an entry point returns. kernel.py makes exceptions of it.
enum Outcome : int { kDone = 0, kOutOfMemory = 1, kOutOfTime = 2, kFailed = 3 };

// The outcome of a function without arguments.
template <typename Function>
int outcome_of(Function function) noexcept {
    try {
        function();
        return kDone;
    } catch (const std::bad_alloc&) {
        return kOutOfMemory;
    } catch (const std::length_error&) {  // of vectors
        return kOutOfMemory;
    } catch (const OutOfTime&) {
        return kOutOfTime;
    } catch (...) {
        return kFailed;
    }
}

// A time limit, which loops look at in each step. The clock itself is read every 1024 steps. A long step counts as many.
class TimeLimit {
public:
    explicit TimeLimit(double seconds) : end_(now() + seconds), is_over_(seconds < 0) {}

    bool is_over(size_t steps = 1) {
        steps_ += steps;
        if (steps_ >= 1024) {
            steps_ = 0;
            is_over_ = is_over_ || now() > end_;
        }
        return is_over_;
    }

    // For loops whose results are of no use before the end.
    void require_time(size_t steps = 1) {
        if (is_over(steps)) throw OutOfTime();
    }

private:
    static double now() {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
    }

    double end_;
    bool is_over_;
    size_t steps_ = 0;
};
