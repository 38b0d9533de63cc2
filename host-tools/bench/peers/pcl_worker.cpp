// Answers `isobath bench --peers` on behalf of PCL: its normals from integral images. The protocol is told in worker.py.
//
// PCL takes organised clouds, and building one from depth is the user's own loop (2 ns a pixel of 30 and more): it is part of every
// timed normal. There is no method for the row `points`: that loop is ours, not PCL's. Holes are NaN, as PCL wants them. The smoothing size 10 and the depth change 0.02 are those of
// PCL's tutorial; size 4 is there for scenes with small things. The estimator and its memory live from frame to frame.

#include <sched.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <pcl/features/integral_image_normal.h>
#include <pcl/pcl_config.h>
#include <pcl/point_types.h>

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Estimator = pcl::IntegralImageNormalEstimation<pcl::PointXYZ, pcl::Normal>;

struct Frame {
    uint32_t width = 0, height = 0;
    float fx = 0, fy = 0, cx = 0, cy = 0;
    std::vector<float> metres;  // NaN where there is no reading
};

struct Method {
    std::string row, id, label;
    std::function<void()> run;
    std::function<size_t()> size;
    std::function<void(size_t, float*)> at;
};

static void to_points(const Frame& frame, Points& cloud) {
    cloud.width = frame.width;
    cloud.height = frame.height;
    cloud.is_dense = false;
    cloud.points.resize(frame.metres.size());
    const float ax = 1.0f / frame.fx, ay = 1.0f / frame.fy;
    size_t i = 0;
    for (uint32_t y = 0; y < frame.height; ++y)
        for (uint32_t x = 0; x < frame.width; ++x, ++i) {
            const float z = frame.metres[i];
            pcl::PointXYZ& p = cloud.points[i];
            p.x = (static_cast<float>(x) - frame.cx) * ax * z;
            p.y = (static_cast<float>(y) - frame.cy) * ay * z;
            p.z = z;
        }
}

static Frame load(std::istringstream& words) {
    Frame frame;
    std::string kind, path;
    words >> frame.width >> frame.height >> kind >> frame.fx >> frame.fy >> frame.cx >> frame.cy >> std::ws;
    std::getline(words, path);
    const size_t n = size_t(frame.width) * frame.height;
    std::ifstream file(path, std::ios::binary);
    frame.metres.resize(n);
    if (kind == "u16") {
        std::vector<uint16_t> raw(n);
        file.read(reinterpret_cast<char*>(raw.data()), std::streamsize(2 * n));
        for (size_t i = 0; i < n; ++i) frame.metres[i] = 0.001f * raw[i];
    } else {
        file.read(reinterpret_cast<char*>(frame.metres.data()), std::streamsize(4 * n));
    }
    if (!file) throw std::runtime_error("can't read " + path);
    for (float& z : frame.metres)
        if (z == 0.0f) z = std::numeric_limits<float>::quiet_NaN();
    return frame;
}

static std::vector<Method> methods(const Frame& frame) {
    std::vector<Method> list;
    auto cloud = std::make_shared<Points>();
    struct Kind {
        const char *id, *label;
        Estimator::NormalEstimationMethod method;
        float size;
    };
    const Kind kinds[] = {
        {"gradient-10", "PCL gradient 10", Estimator::AVERAGE_3D_GRADIENT, 10},
        {"gradient-4", "PCL gradient 4", Estimator::AVERAGE_3D_GRADIENT, 4},
        {"covariance-10", "PCL covariance 10", Estimator::COVARIANCE_MATRIX, 10},
        {"covariance-4", "PCL covariance 4", Estimator::COVARIANCE_MATRIX, 4},
        {"depth-10", "PCL depth 10", Estimator::AVERAGE_DEPTH_CHANGE, 10},
        {"simple-10", "PCL simple 10", Estimator::SIMPLE_3D_GRADIENT, 10},
    };
    for (const Kind& kind : kinds) {
        auto estimator = std::make_shared<Estimator>();
        auto normals = std::make_shared<Normals>();
        estimator->setNormalEstimationMethod(kind.method);
        estimator->setMaxDepthChangeFactor(0.02f);
        estimator->setNormalSmoothingSize(kind.size);
        list.push_back({"normals", kind.id, kind.label,
                        [&frame, cloud, estimator, normals] {
                            to_points(frame, *cloud);
                            estimator->setInputCloud(cloud);
                            estimator->compute(*normals);
                        },
                        [normals] { return normals->size(); },
                        [normals](size_t i, float* out) {
                            const auto& n = normals->points[i];
                            out[0] = n.normal_x, out[1] = n.normal_y, out[2] = n.normal_z;
                        }});
    }
    return list;
}

static int64_t nanoseconds(clockid_t clock) {
    timespec t{};
    clock_gettime(clock, &t);
    return int64_t(t.tv_sec) * 1000000000 + t.tv_nsec;
}

static std::string answer(const std::string& line, Frame& frame, std::vector<Method>& list) {
    std::istringstream words(line);
    std::ostringstream out;
    std::string verb, id;
    words >> verb;
    if (verb == "hello") {
        out << R"({"peer": "PCL", "version": ")" << PCL_VERSION_PRETTY << "\"}";
        return out.str();
    }
    if (verb == "frame") {
        frame = load(words);
        list = methods(frame);
        out << R"({"methods": [)";
        const char* comma = "";
        for (const Method& m : list) {
            out << comma << R"({"row": ")" << m.row << R"(", "id": ")" << m.id << R"(", "label": ")" << m.label << "\"}";
            comma = ", ";
        }
        out << "]}";
        return out.str();
    }
    words >> id;
    for (const Method& m : list) {
        if (m.id != id) continue;
        if (verb == "run") {
            long repeats = 1;
            words >> repeats;
            const int64_t wall = nanoseconds(CLOCK_MONOTONIC), cpu = nanoseconds(CLOCK_PROCESS_CPUTIME_ID);
            for (long i = 0; i < repeats; ++i) m.run();
            out << R"({"cpu_ns": )" << nanoseconds(CLOCK_PROCESS_CPUTIME_ID) - cpu << R"(, "wall_ns": )"
                << nanoseconds(CLOCK_MONOTONIC) - wall << "}";
            return out.str();
        }
        if (verb == "result") {
            std::string path;
            std::getline(words >> std::ws, path);
            m.run();
            if (m.size() != frame.metres.size()) throw std::runtime_error("PCL answered " + std::to_string(m.size()) + " pixels");
            std::vector<float> all(3 * frame.metres.size());
            for (size_t i = 0; i < frame.metres.size(); ++i) m.at(i, &all[3 * i]);
            std::ofstream file(path, std::ios::binary);
            file.write(reinterpret_cast<const char*>(all.data()), std::streamsize(4 * all.size()));
            if (!file.flush()) throw std::runtime_error("can't write " + path);
            out << R"({"written": )" << all.size() << "}";
            return out.str();
        }
    }
    return R"({"error": "not understood"})";
}

int main() {
    cpu_set_t cores;
    if (sched_getaffinity(0, sizeof cores, &cores) == 0)
        for (int i = CPU_SETSIZE - 1; i >= 0; --i)
            if (CPU_ISSET(i, &cores)) {
                CPU_ZERO(&cores);
                CPU_SET(i, &cores);
                sched_setaffinity(0, sizeof cores, &cores);
                break;
            }
    Frame frame;
    std::vector<Method> list;
    for (std::string line; std::getline(std::cin, line) && line != "quit";) {
        std::string said;
        try {
            said = answer(line, frame, list);
        } catch (const std::exception& error) {
            said = error.what();
            for (char& c : said)
                if (c == '"' || c == '\\' || c == '\n') c = ' ';
            said = R"({"error": ")" + said + "\"}";
        }
        std::cout << said << std::endl;
    }
}
