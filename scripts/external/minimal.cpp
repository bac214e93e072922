// A refiner in C++: OpenCV's cornerSubPix where OpenCV is there, else seeds stay where they are.
//
//     c++ -std=c++17 -O2 -o minimal_cpp minimal.cpp $(pkg-config --cflags --libs opencv4)
//     cornerbench measure PLAN --with ./minimal_cpp
//
// What is said is described in scripts/PROTOCOL.md. A question is one line of JSON; what this needs of it stands behind
// known keys, so that nothing more than the standard library reads it. A larger program would take a JSON library.
// Standard output is the protocol's alone: say the rest on standard error.

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <chrono>
#include <iomanip>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

#if __has_include(<opencv2/imgproc.hpp>)
#include <opencv2/imgproc.hpp>
#define HAS_OPENCV 1
#else
#define HAS_OPENCV 0
#endif

struct Point {
    float x, y;
};

// What stands behind a key.
static const char *behind(const std::string &line, const std::string &key) {
    const auto found = line.find(key);
    if (found == std::string::npos) throw std::runtime_error("no " + key + " in the question");
    return line.c_str() + found + key.size();
}

static std::vector<Point> points(const char *text) {
    std::vector<Point> found;
    while (*text == '[' || *text == ',') {
        text += *text == ',' ? 2 : 1;
        char *end;
        const double x = std::strtod(text, &end), y = std::strtod(end + 1, &end);
        found.push_back({static_cast<float>(x), static_cast<float>(y)});
        text = end + 1;
    }
    return found;
}

// The file with the samples, mapped once: it is always the same one, and may only grow.
class Samples {
  public:
    const unsigned char *of(const std::string &path, std::size_t bytes) {
        if (bytes > mapped) {
            const int file = open(path.c_str(), O_RDONLY);
            if (file < 0) throw std::runtime_error(path + " cannot be opened");
            void *begin = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
            close(file);
            if (begin == MAP_FAILED) throw std::runtime_error(path + " cannot be mapped");
            if (mapped) munmap(samples, mapped);
            samples = begin, mapped = bytes;
        }
        return static_cast<const unsigned char *>(samples);
    }

  private:
    void *samples = nullptr;
    std::size_t mapped = 0;
};

static void refine(const unsigned char *image, int width, int height, std::vector<Point> &corners) {
#if HAS_OPENCV
    const cv::Mat picture(height, width, CV_8UC1, const_cast<unsigned char *>(image));
    cv::Mat moved(static_cast<int>(corners.size()), 1, CV_32FC2, corners.data());
    const cv::TermCriteria until(cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 40, 1e-3);
    cv::cornerSubPix(picture, moved, {5, 5}, {-1, -1}, until);
#else
    (void)image, (void)width, (void)height, (void)corners;
#endif
}

int main() {
    std::string line;
    if (!std::getline(std::cin, line)) return 0;
    std::cout << std::setprecision(9);
#if HAS_OPENCV
    cv::setNumThreads(1);
    std::cout << R"({"protocol": 1, "version": "1", "does": ["refine"], "libraries": {"opencv": ")" << CV_VERSION << "\"}}"
              << std::endl;
#else
    std::cout << R"({"protocol": 1, "version": "1, without OpenCV", "does": ["refine"]})" << std::endl;
#endif
    Samples samples;
    while (std::getline(std::cin, line)) {
        const long id = std::strtol(behind(line, "\"id\":"), nullptr, 10);
        try {
            const long width = std::strtol(behind(line, "\"width\":"), nullptr, 10);
            const long height = std::strtol(behind(line, "\"height\":"), nullptr, 10);
            const std::string file = behind(line, "\"file\":\"");
            const auto *image =
                samples.of(file.substr(0, file.find('"')), static_cast<std::size_t>(width * height));
            auto corners = points(behind(line, "\"seeds\":["));
            const auto begun = std::chrono::steady_clock::now();
            refine(image, static_cast<int>(width), static_cast<int>(height), corners);
            const std::chrono::duration<double, std::micro> took = std::chrono::steady_clock::now() - begun;
            std::cout << "{\"id\": " << id << ", \"took_us\": " << took.count() << ", \"points\": [";
            for (std::size_t place = 0; place < corners.size(); ++place) {
                std::cout << (place ? ", [" : "[") << corners[place].x << ", " << corners[place].y << "]";
            }
            std::cout << "]}" << std::endl;
        } catch (const std::exception &error) {
            std::cerr << error.what() << std::endl;
            std::cout << "{\"id\": " << id << ", \"error\": \"the question cannot be answered\"}" << std::endl;
        }
    }
}
